"""The authors' PyTorch checkpoints turned into this project's weights files."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tracker.configs import FULL, LatentProvider, NetworkConfig, TrackerConfig
from tracker.network.climrt import ClimRT
from tracker.weights import PARTS, WeightsError, compare_keys, expected_tensors, save_tensors

# How the authors' partial files name their tensors, and where these belong in the whole network.
_CLIMNET_STARTS = ("encoder.", "decoder.", "feature_fuse.", "outconv.")
_BACKBONE_STARTS = tuple(f"layer{i}." for i in range(1, 6))


@dataclass(frozen=True, slots=True)
class Imported:
    """Where the weights were written, which parts they hold, and how many tensors."""

    path: Path
    parts: tuple[str, ...]
    tensors: int


def import_checkpoint(path: str | Path, out: str | Path, config: NetworkConfig = FULL) -> Imported:
    """Convert t_best.pth (whole), model_best.pth (ClimNet alone) or alexnet-bn.pth (backbone alone).

    Reads with weights_only: nothing in the file is executed. Partial files give partial weights, which
    tracker.weights.load_parts takes. Raises WeightsError naming missing, unexpected and misshapen tensors.
    """
    tensors = {_full_name(key): value for key, value in _read(Path(path)).items()}
    present = {key.split(".", 1)[0] for key in tensors}
    parts = PARTS if "grader" in present else tuple(part for part in PARTS if part in present)
    if not parts:
        raise WeightsError(f"{path}: holds nothing of ClimRT: {compare_keys(tensors, {})}")
    # A network without storage: only names and shapes are wanted of it.
    with torch.device("meta"):
        expected = expected_tensors(ClimRT(config), parts)
    complaint = compare_keys(tensors, expected)
    if complaint:
        raise WeightsError(f"{path}: does not fit the network '{config.name}': {complaint}")
    kept = {key: tensors[key] for key in expected}
    extra = {"source": f"imported from {Path(path).name}"}
    # The authors' tracker draws the latent frame with ClimNet.
    tracker = TrackerConfig(latent=LatentProvider.CLIMNET)
    written = save_tensors(out, kept, config, extra, parts=parts, tracker=tracker)
    return Imported(written, parts, len(kept))


def _read(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise WeightsError(f"{path}: no such checkpoint")
    try:
        content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        # PyTorch's own words here advise switching the protection off.
        raise WeightsError(f"{path}: is no checkpoint, or holds more than plain tensors; not loaded") from error
    except (RuntimeError, EOFError, OSError, ValueError, KeyError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise WeightsError(f"{path}: cannot be read as plain tensors: {reason}") from error
    if isinstance(content, dict) and isinstance(content.get("state_dict"), dict):
        content = content["state_dict"]
    if not isinstance(content, dict) or not content:
        raise WeightsError(f"{path}: is not a dictionary of tensors")
    odd = [str(key) for key, value in content.items() if not isinstance(value, Tensor)]
    if odd:
        raise WeightsError(f"{path}: is not a dictionary of tensors: {odd[0]} is none")
    return {str(key): value for key, value in content.items()}


def _full_name(key: str) -> str:
    """The name in the whole network, without the prefixes that DataParallel and pysot's loaders leave."""
    key = key.removeprefix("module.").removeprefix("features.")
    if key.startswith(_CLIMNET_STARTS):
        return f"internet.{key}"
    if key.startswith(_BACKBONE_STARTS):
        return f"backbone.{key}"
    if key.startswith("backbone.features."):
        return key.replace("backbone.features.", "backbone.", 1)
    return key
