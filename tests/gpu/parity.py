"""How far an engine's full network is from the authors' code: differences from the golden data, and what is allowed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tests.parity.golden import rule
from tests.parity.test_tracking import FRAMES, RUNS, official_box
from tracker.configs import LatentProvider, TrackerConfig
from tracker.engines.eager import EagerEngine
from tracker.engines.engine import Engine, Patch
from tracker.engines.half import Precision
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker

GOLDEN = Path(__file__).parents[1] / "parity" / "golden"
EXPECTED = TrackerConfig(latent=LatentProvider.CLIMNET)  # of the golden tracks


@dataclass(frozen=True, slots=True)
class Differences:
    """Largest ones. features, latent5: as part of the largest value; maps: of the heads' outputs, themselves."""

    features: float
    maps: float
    latent5: float = 0.0

    def within(self, limits: Differences) -> bool:
        """Whether none is over its limit; NaN is over every limit."""
        return all(found <= limit for found, limit in zip(asdict(self).values(), asdict(limits).values(), strict=True))


# 2 to 5 times what was measured on a CPU: FP16 9.7e-4, 8.3e-4, 2.0e-3; BF16 7.8e-3, 4.2e-3, 8.7e-3; TF32, whose
# lost bits may be cut off, 3.6e-3, 3.5e-3, 7.4e-3 (FP16's latent5 and all of TF32 imitated in FP32).
# In FP32, latent5: a grey level here and there is truncated to its neighbour.
LIMITS = {
    Precision.FP32: Differences(1e-4, 1e-4, 2e-3),
    Precision.TF32: Differences(1e-2, 1e-2, 2e-2),
    Precision.FP16: Differences(3e-3, 3e-3, 1e-2),
    Precision.BF16: Differences(2e-2, 2e-2, 3e-2),
}
# Measured likewise: FP32 0.0001, TF32 0.05, FP16 0.024, BF16 0.15.
TRACK_LIMITS_PX = {Precision.FP32: 0.05, Precision.TF32: 0.5, Precision.FP16: 0.5, Precision.BF16: 1.0}


def golden(name: str) -> dict[str, np.ndarray]:
    with np.load(GOLDEN / f"{name}.npz") as file:
        return dict(file)


def patch(seed: int, side: int) -> Patch:
    """(1, side, side, 3) uint8, as engines take them."""
    return torch.from_numpy(rule.patch(seed, side, side)).permute(0, 2, 3, 1).to(torch.uint8).contiguous()


def differences(engine: Engine, device: torch.device, latent5: np.ndarray | None = None) -> Differences:
    """From what the authors' code gives, and of ClimNet from `reference_latent5`, where given."""
    data, heads = golden("a_backbone"), golden("c_lct_heads")
    template, search, latent = (
        engine.embed(patch(seed, side).to(device)) for seed, side in ((100, 127), (200, 287), (300, 287))
    )
    pairs = (
        (template[0], data["z4"]),
        (template[1], data["z5"]),
        (search[0][:, ::24], data["x4_ch0_24"]),
        (search[1][:, ::16], data["x5_ch0_16"]),
    )
    maps = engine.compare(search, template, latent[-1])._asdict()
    return Differences(
        features=max(_farthest(found, wanted) / float(np.abs(wanted).max()) for found, wanted in pairs),
        maps=max(_farthest(found, heads[name]) for name, found in maps.items()),
        latent5=_latent5_difference(engine, device, latent5) if latent5 is not None else 0.0,
    )


def reference_latent5(network: ClimRT) -> np.ndarray:
    """Layer 5 of the frame ClimNet draws between two golden patches, by the reference engine on the CPU; seconds."""
    return EagerEngine(network).imagine(patch(410, 287), patch(510, 287)).numpy()


def _latent5_difference(engine: Engine, device: torch.device, reference: np.ndarray) -> float:
    found = engine.imagine(*(patch(seed, 287).to(device) for seed in (410, 510)))
    return _farthest(found, reference) / float(np.abs(reference).max())


def golden_tracks_px(engine: Engine) -> float:
    """Farthest that a side or place of a box is from the authors' in their two tracks, px (5 frames, ClimNet)."""
    worst_px = 0.0
    for run, kind in RUNS.items():
        data, tracker = golden(run), ClimRTTracker(engine, EXPECTED)
        tracker.init(rule.frame(0, **kind), official_box(data["init_box"]))
        for k in range(1, FRAMES[run] + 1):
            box = tracker.update(rule.frame(k, **kind)).box
            worst_px = max(worst_px, float(np.abs(np.subtract(box.xywh, data[f"t{k}_bbox"])).max()))
    return worst_px


def _farthest(found: Tensor, wanted: np.ndarray) -> float:
    return float(np.abs(found.float().cpu().numpy() - wanted).max())
