from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from tracker import online
from tracker.box import Box
from tracker.configs import COMPACT, LatentProvider, TrackerConfig
from tracker.crop import Image
from tracker.decode import Decoded
from tracker.evidence import RelativeScore
from tracker.network.climrt import ClimRT, Features
from tracker.network.heads import Predictions
from tracker.online import ClimRTTracker, NotInitialisedError
from tracker.train.priming import initial_network


def frame(t: int) -> Image:
    """A light square that moves over dark noise."""
    image = np.random.default_rng(1).integers(0, 60, (120, 160, 3), dtype=np.uint8)
    image[40 : 40 + 24, 30 + 3 * t : 30 + 3 * t + 24] = (40, 180, 250)
    return image


START = Box.from_xywh(30, 40, 24, 24)


@pytest.mark.parametrize("provider", LatentProvider)
def test_runs_on_a_moving_square(tiny: ClimRT, provider: LatentProvider) -> None:
    tracker = ClimRTTracker(tiny, TrackerConfig(latent=provider, latent_interval=2))
    tracker.init(frame(0), START)
    for t in range(1, 4):
        result = tracker.update(frame(t))
        assert result.box.is_valid
        assert math.isfinite(result.score)
        assert 0 <= result.confidence <= 1


def test_a_new_init_forgets_everything(tiny: ClimRT) -> None:
    tracker = ClimRTTracker(tiny, TrackerConfig())
    runs = []
    for _ in range(2):
        tracker.init(frame(0), START)
        runs.append([tracker.update(frame(t)) for t in range(1, 4)])
    assert runs[0] == runs[1]


def test_latent_provider_matters_from_the_second_frame(tiny: ClimRT) -> None:
    results = []
    for provider in (LatentProvider.PREVIOUS, LatentProvider.OFF):
        tracker = ClimRTTracker(tiny, TrackerConfig(latent=provider))
        tracker.init(frame(0), START)
        results.append([tracker.update(frame(t)) for t in (1, 5)])
    assert results[0][0] == results[1][0]  # the first patch has no predecessor
    assert results[0][1] != results[1][1]


def test_bad_input_is_refused_and_leaves_the_track(tiny: ClimRT) -> None:
    tracker = ClimRTTracker(tiny, TrackerConfig())
    with pytest.raises(NotInitialisedError, match="update before init"):
        tracker.update(frame(0))
    tracker.init(frame(0), START)
    with pytest.raises(ValueError, match="too small"):
        tracker.init(frame(0), Box(50, 50, 1, 1))
    with pytest.raises(ValueError, match="float32"):
        tracker.update(frame(1).astype(np.float32))
    again = ClimRTTracker(tiny, TrackerConfig())
    again.init(frame(0), START)
    assert tracker.update(frame(1)) == again.update(frame(1))


def test_a_network_gone_wild_keeps_the_box(tiny: ClimRT) -> None:
    tracker = ClimRTTracker(tiny, TrackerConfig())
    compare = tracker._engine.compare
    tracker._engine.compare = lambda *a: Predictions(*(torch.full_like(maps, math.nan) for maps in compare(*a)))
    tracker.init(frame(0), START)
    result = tracker.update(frame(1))
    assert (result.box, result.score, result.confidence) == (START, 0.0, 0.0)


def test_confidence_is_relative_to_the_start() -> None:
    confidence = RelativeScore()
    assert confidence.update(0.8) == 1.0
    for _ in range(9):
        confidence.update(0.8)
    assert confidence.update(0.4) == pytest.approx(0.5)
    assert confidence.update(1.6) == pytest.approx(2.0)
    for score in (0.0, -3.0, math.nan):
        assert confidence.update(score) == 0.0
    assert confidence.update(0.2) == pytest.approx(0.25)  # the reference has not moved


def _size_seen_at_once(calibrate: bool) -> tuple[float, float]:
    """Width and height that the first update gives on the first frame itself, from 120 x 30 px."""
    # The window alone chooses the cell: an untrained network's scores say nothing.
    plain = TrackerConfig(latent=LatentProvider.OFF, cls2_is_logit=False, size_rate=3.0, window_influence=1.0)
    config = replace(plain, calibrate=calibrate)
    tracker = ClimRTTracker(initial_network(COMPACT, 3).eval(), config)
    image = cv2.resize(np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8), (640, 480))
    tracker.init(image, Box(320.0, 240.0, 120.0, 30.0))
    box = tracker.update(image).box
    return box.w_px, box.h_px


def test_calibration_takes_the_bias_in_size_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online, "GAIN_RANGE", (0.1, 10.0))  # an untrained network is further off than any other
    biased = _size_seen_at_once(False)
    assert abs(biased[1] / 30 - 1) > 0.08
    assert _size_seen_at_once(True) == pytest.approx((120, 30), rel=0.01)


class Scripted(ClimRTTracker):
    """Finds what the script says; the rest is the tracker's own."""

    def __init__(self, *found: tuple[float, float]) -> None:
        """found: centre x and score of each coming frame."""
        config = TrackerConfig(latent=LatentProvider.OFF, lost_below=0.5, found_above=0.75)
        super().__init__(ClimRT(COMPACT).eval(), config)
        self._script = iter(found)

    def _step(self, frame_bgr: Image, template: Features) -> Decoded:
        x, score = next(self._script)
        none = np.zeros(121)
        return Decoded(Box(x, 52.0, 24.0, 24.0), score, 60, np.zeros((4, 121)), none, none, none)


def test_a_hidden_object_is_believed_back_only_when_sure_and_near_where_it_is_looked_for() -> None:
    tracker = Scripted(*[(42, 0.8)] * 10, (43, 0.3), (44, 0.5), (140, 0.8), (60, 0.8))
    tracker.init(frame(0), START)
    assert all(tracker.update(frame(1)).visible for _ in range(10))
    assert not tracker.update(frame(2)).visible  # the score falls
    assert not tracker.update(frame(3)).visible  # half as sure is not enough to be back
    tracker.look_at(58.0, 52.0)
    assert not tracker.update(frame(4)).visible  # sure, but far from there
    tracker.look_at(58.0, 52.0)
    assert tracker.update(frame(5)).visible


def test_where_to_look_is_heeded_only_while_hidden() -> None:
    tracker = Scripted((42, 0.8), (90, 0.8))
    tracker.init(frame(0), START)
    tracker.update(frame(1))
    tracker.look_at(10.0, 10.0)
    assert tracker._box.cx_px == 42
    tracker.update(frame(2))
    tracker.look_at(math.nan, 10.0)
    assert tracker._box.cx_px == 90
