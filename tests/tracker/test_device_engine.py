"""The engine for GPUs, on the CPU: everything but the recording of graphs is the same there."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.tracker.conftest import random_network
from tests.tracker.test_online import START, frame
from tracker.configs import LatentProvider, TrackerConfig
from tracker.engines.cuda import CudaEngine
from tracker.engines.eager import EagerEngine
from tracker.engines.half import Precision
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker

FILL = (9, 99, 199)


def track(engine: object, provider: LatentProvider = LatentProvider.CLIMNET) -> list[object]:
    config = TrackerConfig(latent=provider, filter_weight=0.2, redetect=True, lost_below=0.3, found_above=0.5)
    tracker = ClimRTTracker(engine, config)
    tracker.init(frame(0), START)
    return [tracker.update(frame(t)) for t in range(1, 5)]


def test_in_fp32_it_tracks_as_the_reference_engine(tiny: ClimRT) -> None:
    assert track(CudaEngine(tiny, Precision.FP32)) == track(EagerEngine(tiny))


def test_warming_up_changes_nothing(tiny: ClimRT) -> None:
    warm = CudaEngine(tiny, Precision.BF16)
    warm.warm_up(TrackerConfig(latent=LatentProvider.CLIMNET))
    assert track(warm) == track(CudaEngine(tiny, Precision.BF16))


@pytest.mark.parametrize("precision", Precision)
def test_names_types_and_shapes(tiny: ClimRT, precision: Precision) -> None:
    engine = CudaEngine(tiny, precision)
    assert engine.name == f"cuda-{precision.value}"
    assert engine.has_climnet
    template = engine.embed(engine.cut(frame(0), 42, 52, 30, 127, FILL))
    patch = engine.cut(frame(0), 42, 52, 70, 287, FILL)
    search = engine.embed(patch)
    predictions = engine.compare(search, template, engine.imagine(patch, patch))
    assert [tuple(maps.shape) for maps in predictions] == [(1, 4, 11, 11), (1, 2, 11, 11), (1, 1, 11, 11)]
    assert {each.dtype for each in (*template, *search, *predictions)} == {torch.float32}


def test_what_it_gave_stays_as_it_was(tiny: ClimRT) -> None:
    engine = CudaEngine(tiny, Precision.FP32)
    patch = engine.cut(frame(0), 42, 52, 70, 287, FILL)
    kept = (patch, *engine.embed(patch))
    copies = [each.clone() for each in kept]
    engine.embed(engine.cut(frame(3), 60, 52, 70, 287, FILL))
    assert all(torch.equal(*pair) for pair in zip(kept, copies, strict=True))


def test_a_network_without_climnet(tiny: ClimRT) -> None:
    plain = random_network()
    plain.internet = None
    assert not CudaEngine(plain, Precision.BF16).has_climnet


def test_one_frame_goes_up_once_however_often_it_is_cut(tiny: ClimRT) -> None:
    engine, image = CudaEngine(tiny, Precision.FP32), frame(0)
    for cx_px in (42, 80, 500):  # the last one is all outside
        engine.cut(image, cx_px, 52, 30, 127, FILL)
    assert engine._frame.uploads == 1
    engine.cut(image.copy(), 42, 52, 30, 127, FILL)
    assert engine._frame.uploads == 2


def test_an_array_used_again_for_the_next_picture_is_seen(tiny: ClimRT) -> None:
    engine, buffer = CudaEngine(tiny, Precision.FP32), frame(0)
    reference = EagerEngine(tiny)
    for t in range(4):
        np.copyto(buffer, frame(t))
        for cx_px in (42.0, 60.0):
            found = engine.cut(buffer, cx_px, 52, 30, 127, FILL)
            assert torch.equal(found, reference.cut(frame(t), cx_px, 52, 30, 127, FILL))


def test_frames_of_any_layout_and_size(tiny: ClimRT) -> None:
    engine, reference = CudaEngine(tiny, Precision.FP32), EagerEngine(tiny)
    for image in (frame(0)[::-1], frame(0)[:, 10:150], frame(0)[:50, :60]):
        image.flags.writeable = False
        assert torch.equal(engine.cut(image, 30, 40, 50, 127, FILL), reference.cut(image, 30, 40, 50, 127, FILL))
