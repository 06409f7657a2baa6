"""`gcs weights train`: arguments to a run."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tracker.train import checkpoint
from tracker.train.clock import Slice
from tracker.train.config import TrainConfig, TrainConfigError
from tracker.train.datasets import load_sources
from tracker.train.devices import Team, assemble
from tracker.train.export import export
from tracker.train.loop import Run
from tracker.train.pack import Imagery
from tracker.train.probe import probe
from tracker.train.progress import Say

PROBE_MINUTES = 1.0


@dataclass(frozen=True, slots=True)
class Options:
    """Beside the configuration: minutes of the whole slice, start-up included; where to go on from; devices."""

    minutes: float = float("inf")
    resume: bool = False
    start_from: str = ""  # over the configuration's
    devices: int = 1
    device: str = "auto"
    probe: bool = False


def train(values: Mapping[str, Any], data: Path, folder: Path, options: Options, say: Say) -> bool:
    """Run or go on with a training, or probe one; True when its schedule is done.

    values: the training configuration (tracker.train.config). data: folder with the packs. Raises
    TrainConfigError, DatasetError, CheckpointError and WeightsError with one clear line.
    """
    slice_ = Slice.of(options.minutes)
    config = TrainConfig.from_dict(dict(values))
    if options.start_from:
        config = replace(config, start_from=options.start_from)
    team = assemble(options.devices, options.device)
    done = _train(config, data, folder, options, slice_, team, say if team.leads else _silence)
    team.disband()
    return done


def _train(
    config: TrainConfig, data: Path, folder: Path, options: Options, slice_: Slice, team: Team, speak: Say
) -> bool:
    if options.probe:
        speak("reading pictures")
        minutes = PROBE_MINUTES if math.isinf(options.minutes) else options.minutes
        probe(config, load_sources(config.packs, data), team, minutes, speak)
        return True
    run = _begin(config, folder, team, options, speak)
    speak("reading pictures")
    imagery = load_sources(config.packs, data)
    held_out = load_sources(config.packs, data, split="val") if team.leads else None
    speak(_described(imagery, held_out))
    done = run.train(imagery, held_out, slice_)
    if run.interrupted:
        speak(f"interrupted: saved in {folder / 'last.pt'}; --resume goes on")
    elif team.leads:
        best = folder / "best.pt"
        path = export(best if best.exists() else folder / "last.pt", folder / "weights.safetensors", data)
        speak(f"weights written to {path}")
    return done


def _begin(config: TrainConfig, folder: Path, team: Team, options: Options, speak: Say) -> Run:
    """The run where it stopped, or at the start of its schedule."""
    last = folder / "last.pt"
    there = team.share(last.exists())
    if there and not options.resume:
        raise TrainConfigError(f"{folder}: holds a run already; --resume goes on with it, or name another folder")
    run = Run(config, folder, team, speak, live=sys.stderr.isatty())
    if there:
        checkpoint.resume(run, last)
        speak(f"going on from {last} ({run.position.samples} samples seen)")
    elif config.start_from:
        speak(checkpoint.start_from(run, config.start_from))
    return run


def _described(imagery: Imagery, held_out: Imagery | None) -> str:
    kept = f"; {len(held_out)} held out" if held_out is not None else ""
    return f"{len(imagery)} pictures, {len(imagery.things)} objects{kept}"


def _silence(_line: str) -> None:
    """Only the leader speaks."""
