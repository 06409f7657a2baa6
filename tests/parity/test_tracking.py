"""Crops, decoding and whole tracking runs against the authors' code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests.parity.conftest import Golden
from tests.parity.golden import rule
from tracker.box import Box
from tracker.configs import COMPACT, LatentProvider, TrackerConfig
from tracker.crop import Image, crop, mean_colour
from tracker.decode import Decoded, decode
from tracker.engines.eager import EagerEngine
from tracker.network.climrt import ClimRT
from tracker.network.heads import Predictions
from tracker.online import ClimRTTracker

Data = Mapping[str, NDArray[np.generic]]
RUNS = {"d_track_center": {}, "d_track_border": {"obj_xy": (10, 430), "obj_wh": (60, 36), "step": (-6, 4)}}
FRAMES = {"d_track_center": 3, "d_track_border": 2}


def official_box(xywh: NDArray[np.generic]) -> Box:
    """The authors' init takes the centre of a w x h box of whole pixels: x + (w-1)/2."""
    x, y, w, h = (float(v) for v in xywh)
    return Box(x + (w - 1) / 2, y + (h - 1) / 2, w, h)


class Scripted(ClimRTTracker):
    """A tracker whose network's answer is given."""

    def __init__(self, maps: list[NDArray[np.generic]]) -> None:
        torch.manual_seed(0)
        super().__init__(ClimRT(COMPACT), TrackerConfig())
        answer = Predictions(*(torch.from_numpy(np.asarray(m))[None] for m in maps))
        self._engine.compare = lambda *_: answer


def run_case(data: Data, case: int) -> tuple[Scripted, Image]:
    tracker = Scripted([data[f"{case}_{name}"] for name in ("loc", "cls1", "cls2")])
    height, width = (int(n) for n in data[f"{case}_hw"])
    frame = np.zeros((height, width, 3), np.uint8)
    tracker.init(frame, official_box(data[f"{case}_box"]))
    return tracker, frame


@pytest.mark.parametrize("case", range(4))
def test_decode(golden: Golden, case: int) -> None:
    data = golden("d2_decode")
    tracker, frame = run_case(data, case)
    for name in ("bbox", "bbox_second"):
        result = tracker.update(frame)
        np.testing.assert_allclose(result.box.xywh, data[f"{case}_{name}"], rtol=1e-6, atol=1e-5)
        if name == "bbox":
            assert result.score == pytest.approx(float(data[f"{case}_score"]), rel=1e-6)


def test_decode_does_not_choose_nan(golden: Golden) -> None:
    """The authors' argmax picks one of four NaN cells and the box collapses to 10x10; ours passes them by."""
    data = golden("d2_decode")
    assert int(data["4_n_nan"]) == 4
    assert list(data["4_bbox"][2:]) == [10, 10]
    tracker, frame = run_case(data, 4)
    result = tracker.update(frame)
    assert all(map(math.isfinite, result.box.xywh))
    assert min(result.box.w_px, result.box.h_px) > 10
    assert result.score > float(data["4_score"])


@pytest.mark.parametrize("run", RUNS)
def test_decode_of_recorded_maps(golden: Golden, run: str) -> None:
    data = golden(run)
    old = official_box(data["init_box"])
    for k in range(1, FRAMES[run] + 1):
        maps = [data[f"t{k}_{name}"] for name in ("loc", "cls1", "cls2")]
        decoded = decode(*maps, old, float(data[f"t{k}_scale_z"]), (640, 480), TrackerConfig())
        check_decoded(decoded, data, k)
        old = decoded.box


def check_decoded(decoded: Decoded, data: Data, k: int) -> None:
    np.testing.assert_allclose(decoded.offsets_px, data[f"t{k}_pred_xywh"], rtol=1e-6, atol=2e-4)
    np.testing.assert_allclose(decoded.scores, data[f"t{k}_score"], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(decoded.penalties, data[f"t{k}_penalty"], rtol=1e-5)
    np.testing.assert_allclose(decoded.ranks, data[f"t{k}_pscore"], rtol=1e-5, atol=1e-6)
    assert decoded.best == int(data[f"t{k}_best_idx"])
    np.testing.assert_allclose(decoded.box.xywh, data[f"t{k}_bbox"], rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("run", RUNS)
def test_crops(golden: Golden, run: str) -> None:
    data = golden(run)
    frames = [rule.frame(t, **RUNS[run]) for t in range(FRAMES[run] + 1)]
    fill = mean_colour(frames[0])
    assert fill == tuple(int(v) for v in data["chan_avg"])
    crops = [(frames[0], data["init_center"], data["init_crop_size"], 127, data["z_crop"])]
    for k in range(1, FRAMES[run] + 1):
        centre, size = data[f"t{k}_crop_center"], data[f"t{k}_crop_size"]
        crops.append((frames[k], centre, size, 287, data[f"t{k}_x_crop"]))
    for frame, centre, size, out_px, wanted in crops:
        found = crop(frame, float(centre[0]), float(centre[1]), int(size), out_px, fill).transpose(2, 0, 1)
        # Another OpenCV may round a resized pixel the other way.
        assert np.abs(found.astype(int) - wanted.astype(int)).max() <= 1


class StoredCrops(EagerEngine):
    """An engine fed with the recorded patches, so that the track does not hang on one OpenCV's rounding."""

    def __init__(self, network: ClimRT, data: Data) -> None:
        super().__init__(network)
        self.data, self.step = data, 0

    def cut(self, *where: Any) -> torch.Tensor:
        wanted = self.data["z_crop" if self.step == 0 else f"t{self.step}_x_crop"]
        self.step += 1
        patch = super().cut(*where)[0].numpy()
        assert np.abs(patch.transpose(2, 0, 1).astype(int) - wanted.astype(int)).max() <= 1
        return torch.from_numpy(np.ascontiguousarray(wanted.transpose(1, 2, 0)).astype(np.uint8))[None]


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_whole_tracking_with_climnet(full: ClimRT, golden: Golden, run: str) -> None:
    data = golden(run)
    engine = StoredCrops(full, data)
    tracker = ClimRTTracker(engine, TrackerConfig(latent=LatentProvider.CLIMNET))
    tracker.init(rule.frame(0, **RUNS[run]), official_box(data["init_box"]))
    for k in range(1, FRAMES[run] + 1):
        result = tracker.update(rule.frame(k, **RUNS[run]))
        np.testing.assert_allclose(result.box.xywh, data[f"t{k}_bbox"], rtol=0, atol=0.05)
        assert result.score == pytest.approx(float(data[f"t{k}_best_score"]), abs=1e-3)
    assert engine.step == 1 + FRAMES[run]
