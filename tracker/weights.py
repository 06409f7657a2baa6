"""Weights on disk: a safetensors file and a JSON manifest beside it that says what they are. Never a pickle."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from tracker.confidence import ConfidenceError, ConfidenceModel
from tracker.configs import ConfigError, LatentProvider, NetworkConfig, TrackerConfig
from tracker.engines.catalogue import TORCH, make_engine
from tracker.engines.export_files import read_graphs
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker, Loaded

FORMAT = "climrt-weights/1"
DATA = Path(__file__).parent / "data"
PARTS = ("backbone", "internet", "grader")  # the authors' names of backbone, ClimNet and heads
# In the authors' checkpoints, read by none of their code.
UNUSED_KEYS = ("num_batches_tracked", ".eles.", ".bn3d.")


class WeightsError(ValueError):
    """A weights file is missing, damaged or of another kind; one line naming the file and the reason."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a weights file holds.

    parts: of backbone, internet (ClimNet) and grader. extra: training data credits, seed, metrics and so on.
    """

    network: NetworkConfig
    tracker: TrackerConfig
    sha256: str
    parts: tuple[str, ...]
    extra: dict[str, Any]

    @property
    def confidence(self) -> ConfidenceModel | None:
        """From evidence to probability, where it was calibrated. Raises ConfidenceError."""
        values = self.extra.get("confidence")
        return ConfidenceModel.from_dict(values) if values is not None else None


def save(
    path: str | Path,
    network: ClimRT,
    manifest_extra: Mapping[str, Any] | None = None,
    *,
    tracker: TrackerConfig | None = None,
    half: bool = False,
) -> Path:
    """Write `path` (.safetensors) and its manifest (.json beside it); returns the path.

    half stores the kernels as float16; statistics and biases, which may not fit, stay float32.
    manifest_extra must be JSON values.
    """
    parts = tuple(part for part in PARTS if getattr(network, part) is not None)
    return save_tensors(
        path, network.state_dict(), network.config, manifest_extra, parts=parts, tracker=tracker, half=half
    )


def save_tensors(
    path: str | Path,
    tensors: Mapping[str, Tensor],
    config: NetworkConfig,
    manifest_extra: Mapping[str, Any] | None = None,
    *,
    parts: tuple[str, ...] = PARTS,
    tracker: TrackerConfig | None = None,
    half: bool = False,
) -> Path:
    """As save, from a state dict."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = {key: _stored(value, half) for key, value in tensors.items() if not _unused(key)}
    temporary = path.with_name(path.name + ".part")
    save_file(kept, temporary)
    manifest = {
        "format": FORMAT,
        "sha256": _sha256(temporary),
        "network": config.to_dict(),
        "tracker": (tracker or TrackerConfig()).to_dict(),
        "parts": list(parts),
        **(manifest_extra or {}),
    }
    os.replace(temporary, path)
    _write_json(_manifest_path(path), manifest)
    return path


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
    os.replace(temporary, path)


def read_manifest(path: str | Path) -> Manifest:
    """The manifest beside a weights file. Raises WeightsError."""
    path = Path(path)
    if not path.is_file():
        raise WeightsError(f"{path}: no such weights file")
    source = _manifest_path(path)
    try:
        values = json.loads(source.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise WeightsError(f"{path}: its manifest {source.name} is missing beside it") from None
    except (OSError, ValueError) as error:
        raise WeightsError(f"{source}: cannot be read as JSON: {error}") from error
    if not isinstance(values, dict) or values.pop("format", None) != FORMAT:
        raise WeightsError(f"{source}: is not a {FORMAT} manifest")
    try:
        if not all(isinstance(part, str) for part in values["parts"]):
            raise TypeError("parts must be names")
        return Manifest(
            NetworkConfig.from_dict(values.pop("network")),
            TrackerConfig.from_dict(values.pop("tracker")),
            str(values.pop("sha256")),
            tuple(values.pop("parts")),
            values,
        )
    except (KeyError, TypeError, ConfigError) as error:
        raise WeightsError(f"{source}: is incomplete or malformed: {error}") from error


def amend(path: str | Path, extra: Mapping[str, Any], tracker: TrackerConfig | None = None) -> None:
    """Put entries into a weights file's manifest, and another tracker configuration where one is given.

    Raises WeightsError where there is no manifest to amend.
    """
    manifest = read_manifest(path)
    source = _manifest_path(Path(path))
    values = json.loads(source.read_text(encoding="utf-8"))
    values |= {"tracker": (tracker or manifest.tracker).to_dict(), **extra}
    _write_json(source, values)


def load_network(path: str | Path) -> ClimRT:
    """The network of a weights file, on the CPU, in eval mode; checks the file's sha256. Raises WeightsError."""
    manifest = read_manifest(path)
    wanted = tuple(part for part in PARTS if part != "internet" or manifest.network.climnet is not None)
    if set(manifest.parts) != set(wanted):
        raise WeightsError(f"{path}: holds only {', '.join(manifest.parts)}, not a whole network")
    network = ClimRT(manifest.network)
    load_parts(path, network)
    return network.eval()


def load_parts(path: str | Path, network: ClimRT) -> tuple[str, ...]:
    """Load the parts that the file holds into a network of that configuration; returns their names."""
    path = Path(path)
    manifest = read_manifest(path)
    if _sha256(path) != manifest.sha256:
        raise WeightsError(f"{path}: sha256 is not the manifest's: the file is damaged or another one")
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: cannot be read as safetensors: {error}") from error
    expected = expected_tensors(network, manifest.parts)
    complaint = compare_keys(tensors, expected)
    if complaint:
        raise WeightsError(f"{path}: does not fit the network '{network.config.name}': {complaint}")
    network.load_state_dict(tensors, strict=False)
    return manifest.parts


def find_weights(name_or_path: str | Path) -> Path:
    """The file of shipped weights by name, or the path itself. Raises WeightsError for a name that is none."""
    path, shipped = Path(name_or_path), DATA / f"{name_or_path}.safetensors"
    if path.suffix == ".safetensors" or (path.is_file() and not shipped.is_file()):
        return path
    if not shipped.is_file():
        names = ", ".join(sorted(p.stem for p in DATA.glob("*.safetensors"))) or "none"
        raise WeightsError(f"{name_or_path}: no shipped weights of that name (there are: {names})")
    return shipped


def load_tracker(
    name_or_path: str | Path = "compact",
    *,
    latent: LatentProvider | None = None,
    latent_interval: int | None = None,
    threads: int | None = None,
    engine: str = TORCH,
    graphs: str | Path | None = None,
) -> ClimRTTracker:
    """A tracker ready for init: shipped weights by name ("compact"), or a .safetensors file by path.

    latent, latent_interval: override the manifest's. threads: CPU threads of the engine; None: as many as PyTorch has,
    for another engine one. graphs: folder of what was exported from these weights, to be run as it is. Raises
    WeightsError, EngineError, and ConfigError for latent = climnet with weights that hold no ClimNet.
    """
    path = find_weights(name_or_path)
    manifest = read_manifest(path)
    config = manifest.tracker if latent is None else replace(manifest.tracker, latent=latent)
    if latent_interval is not None:
        config = replace(config, latent_interval=latent_interval)
    try:
        confidence = manifest.confidence
    except ConfidenceError as error:
        raise WeightsError(f"{_manifest_path(path)}: {error}") from error
    count = threads or (torch.get_num_threads() if engine == TORCH else 1)
    # What PyTorch still does beside another engine is little, and its threads would be in the way.
    threads_of_torch = threads if engine == TORCH else 1
    network = load_network(path) if graphs is None else read_graphs(graphs, weights_sha256=manifest.sha256)
    runs = make_engine(engine, network, count, climnet=config.latent is LatentProvider.CLIMNET)
    tracker = ClimRTTracker(runs, config, confidence=confidence, threads=threads_of_torch)
    tracker.loaded = Loaded(str(name_or_path), manifest.sha256, runs.name, count)
    return tracker


def expected_tensors(network: ClimRT, parts: tuple[str, ...]) -> dict[str, Tensor]:
    """The tensors that the given parts of a network need."""
    return {
        key: value for key, value in network.state_dict().items() if key.split(".", 1)[0] in parts and not _unused(key)
    }


def compare_keys(found: Mapping[str, Tensor], expected: Mapping[str, Tensor]) -> str:
    """What is missing, unexpected or of another shape, in one line; empty if nothing is."""
    missing = [key for key in expected if key not in found]
    unexpected = [key for key in found if key not in expected and not _unused(key)]
    misshapen = [
        f"{key} is {tuple(found[key].shape)}, not {tuple(value.shape)}"
        for key, value in expected.items()
        if key in found and found[key].shape != value.shape
    ]
    kinds = (("missing", missing), ("unexpected", unexpected), ("of another shape", misshapen))
    return "; ".join(f"{len(keys)} {kind} ({_some(keys)})" for kind, keys in kinds if keys)


def _some(keys: list[str], limit: int = 4) -> str:
    more = f", and {len(keys) - limit} more" if len(keys) > limit else ""
    return ", ".join(keys[:limit]) + more


def _unused(key: str) -> bool:
    return any(part in key for part in UNUSED_KEYS)


def _stored(value: Tensor, half: bool) -> Tensor:
    dtype = torch.float16 if half and value.ndim >= 2 else torch.float32
    return value.detach().to("cpu", dtype).contiguous()


def _manifest_path(path: Path) -> Path:
    return path.with_suffix(".json")


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
