"""The confidence of weights, fitted to held-out clips and used by the tracker that they make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.box import Box
from tracker.configs import COMPACT, LatentProvider, TrackerConfig
from tracker.evidence import Evidence
from tracker.train import calibrate as module
from tracker.train.calibrate import calibrate, rehearsal_clips
from tracker.train.pack import load
from tracker.train.priming import initial_network
from tracker.weights import WeightsError, amend, load_tracker, read_manifest, save

from .packs import write_pack

TINY = replace(COMPACT, name="tiny", backbone_channels=(8, 8, 16, 16, 16), hidden=16, heads=2, ffn=16, climnet=None)
TINY = replace(TINY, group_norm_groups=4)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    config = TrackerConfig(
        cls2_is_logit=False,
        latent=LatentProvider.OFF,
        filter_share=0.5,
        redetect=True,
        lost_below=0.4,
        found_above=0.6,
    )
    return save(
        tmp_path / "w.safetensors", initial_network(TINY, 1), tracker=replace(config, lost_below=0.4, found_above=0.6)
    )


def test_calibration_goes_into_the_manifest_and_is_used(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "COMPOSED_CLIPS", 3)
    monkeypatch.setattr(module, "CLIP_FRAMES", 8)
    held_out = load([write_pack(tmp_path / "pack", split="val")], split="val")
    said: list[str] = []
    found = calibrate(weights, held_out, said.append)
    assert found.observations >= 50
    assert "calibration error" in said[0]
    assert (tmp_path / "w-reliability.png").stat().st_size > 1000
    manifest = read_manifest(weights)
    assert manifest.confidence == found.model
    assert found.model.names == Evidence.NAMES
    assert manifest.tracker.lost_below == 0.4  # the tracker's settings stay
    tracker = load_tracker(weights)
    image = np.asarray(held_out.pyramids[0][0])
    tracker.init(image, Box.from_xywh(60, 50, 50, 36))
    result = tracker.update(image)
    assert tracker.evidence is not None
    if result.visible:
        assert result.confidence == found.model.probability(tracker.evidence.values)


def test_rehearsal_clips_hide_their_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "COMPOSED_CLIPS", 6)
    clips = rehearsal_clips(load([write_pack(tmp_path / "pack", count=12, split="val")], split="val"), 1)
    truths = [np.isnan(c.truth_xywh).any(1) for c in clips]
    assert any(t.any() for t in truths)
    assert not any(t[0] for t in truths)


def test_amending_keeps_the_rest_and_a_broken_model_is_one_line(weights: Path) -> None:
    sha256 = read_manifest(weights).sha256
    amend(weights, {"confidence": {"names": ["score"], "weights": [1.0]}})
    assert read_manifest(weights).sha256 == sha256
    with pytest.raises(WeightsError, match="confidence model is incomplete"):
        load_tracker(weights)
