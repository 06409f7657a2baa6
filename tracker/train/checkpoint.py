"""Checkpoints: written whole or not at all, gone on from, or started from."""

from __future__ import annotations

import json
import pickle
import random
from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from tracker.network.climrt import ClimRT
from tracker.train.schedule import Position
from tracker.train.widen import can_widen, widen
from tracker.weights import DATA, PARTS, load_parts, read_manifest

if TYPE_CHECKING:
    from tracker.train.loop import Run

NAMES = {"backbone": "the backbone", "internet": "ClimNet", "grader": "the grader"}


class CheckpointError(ValueError):
    """A checkpoint cannot be used; the message names the file and what does not fit."""


def save(run: Run, path: Path) -> None:
    """Everything needed to go on."""
    state = {
        "network": run.network.state_dict(),
        "average": run.average.state_dict(),
        "response": run.response.state_dict(),
        "optimizer": run.optimizer.state_dict(),
        "plateau": run.plateau.state_dict(),
        "position": list(astuple(run.position)),
        "random": _random_state(run),
        "config": json.dumps(run.config.to_dict()),
    }
    part = path.with_name(f"{path.name}.part")
    torch.save(state, part)
    part.replace(path)


def read(path: Path) -> dict[str, Any]:
    """A checkpoint's values, on the CPU; nothing in it is executed. Raises CheckpointError."""
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such checkpoint") from None
    except (OSError, RuntimeError, pickle.UnpicklingError, EOFError) as error:
        raise CheckpointError(f"{path}: cannot be read as a checkpoint ({_first_line(error)})") from error
    if not isinstance(state, dict):
        raise CheckpointError(f"{path}: not a checkpoint")
    return state


def resume(run: Run, path: Path) -> None:
    """Go on where the checkpoint stopped, in every process; raises CheckpointError where it is of another run."""
    state = run.team.share(read(path) if run.team.leads else {})
    try:
        run.network.load_state_dict(state["network"])
        run.average.load_state_dict(state["average"])
        run.response.load_state_dict(state["response"])
        run.position = Position(*state["position"])
        run.position.stage = int(run.position.stage)
        run.enter_stage()
        run.optimizer.load_state_dict(state["optimizer"])
        run.plateau.load_state_dict(state.get("plateau", {}))
        _restore_random(run, state.get("random", {}))
    except (KeyError, RuntimeError, ValueError, TypeError) as error:
        raise CheckpointError(f"{path}: not a checkpoint of this run ({_first_line(error)})") from error


def start_from(run: Run, source: str) -> str:
    """Begin a new schedule with the weights of a checkpoint (.pt, its averaged ones), weights file or shipped name.

    A weights file of a narrower network is widened where that changes nothing it says (tracker.train.widen).
    Returns a line that says which parts fitted; a part most of which does not keeps its fresh values. Raises
    CheckpointError where none fits, WeightsError for a broken weights file.
    """
    weights, response, samples = run.team.share(_source(source, run) if run.team.leads else None)
    own = run.network.state_dict()
    fitting = _fitting(own, weights)
    if not fitting:
        raise CheckpointError(f"{source}: nothing in it fits the network '{run.network.config.name}'")
    run.network.load_state_dict(fitting, strict=False)
    run.average.load_state_dict(fitting, strict=False)
    if {k: v.shape for k, v in response.items()} == {k: v.shape for k, v in run.response.state_dict().items()}:
        run.response.load_state_dict(response)
    run.position.samples = samples
    return f"starting from {source} ({samples} samples seen): {_fits(own, fitting, weights)}"


def _source(source: str, run: Run) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor], int]:
    """Network weights, the response's, and how many samples they have seen."""
    path = Path(source)
    if path.suffix == ".safetensors" or not path.suffix:
        return _weights(path if path.suffix else DATA / f"{source}.safetensors", run)
    state = read(path)
    try:
        return state["average"], state["response"], int(state["position"][3])
    except (KeyError, IndexError, TypeError) as error:
        raise CheckpointError(f"{source}: not a training checkpoint (no {_first_line(error)})") from error


def _weights(path: Path, run: Run) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor], int]:
    manifest = read_manifest(path)
    network = ClimRT(manifest.network)
    parts = load_parts(path, network)
    if can_widen(manifest.network, run.network.config):
        network = widen(network, run.network.config, seed=run.config.seed)
        if manifest.network.climnet != run.network.config.climnet:
            parts = tuple(part for part in parts if part != "internet")  # drawn anew, as if it were not in it
    tensors = {k: v for k, v in network.state_dict().items() if k.split(".", 1)[0] in parts}
    return tensors, {}, int(manifest.extra.get("samples", 0))


def _tensors(network: Mapping[str, Any], part: str) -> list[str]:
    return [k for k in network if k.split(".", 1)[0] == part and not k.endswith("num_batches_tracked")]


def _fitting(own: Mapping[str, torch.Tensor], found: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """What can be taken over, of the parts that fit for the most: a few small tensors fit anything."""
    fitting = {k: v for k, v in found.items() if k in own and own[k].shape == v.shape}
    parts = [p for p in PARTS if 2 * sum(k in fitting for k in _tensors(own, p)) > len(_tensors(own, p))]
    return {k: v for k, v in fitting.items() if k.split(".", 1)[0] in parts}


def _fits(own: Mapping[str, Any], fitting: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """Part by part: taken, partly taken with what is not, or drawn anew."""
    said = []
    for part in PARTS:
        wanted = _tensors(own, part)
        missing = [k for k in wanted if k not in fitting]
        if not wanted:
            continue
        if not missing:
            said.append(f"{NAMES[part]} taken")
        elif len(missing) == len(wanted):
            why = "of another shape there" if any(k in found for k in wanted) else "not in it"
            said.append(f"{NAMES[part]} is {why}: begins anew")
        else:
            said.append(f"{NAMES[part]} taken but for {len(missing)} of {len(wanted)} tensors ({missing[0]} ...)")
    return ", ".join(said)


def _random_state(run: Run) -> dict[str, Any]:
    cuda = torch.cuda.get_rng_state_all() if run.device.type == "cuda" else []
    return {"torch": torch.get_rng_state(), "cuda": cuda, "python": random.getstate(), "dice": run.objective.dice_state}


def _restore_random(run: Run, state: Mapping[str, Any]) -> None:
    """As it was in the leader; the other processes draw differently."""
    if not state:
        return
    random.setstate(state["python"])
    run.objective.dice_state = state["dice"]
    if run.team.leads:
        torch.set_rng_state(state["torch"])
        if state["cuda"] and run.device.type == "cuda":
            torch.cuda.set_rng_state(state["cuda"][0], run.device)
    else:
        torch.manual_seed(run.config.seed + 7919 * run.team.rank + run.position.samples)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
