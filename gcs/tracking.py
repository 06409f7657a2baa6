"""The tracker as the rest of the program sees it, and how the configuration makes one."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from gcs.config import TrackerConfig
from gcs.errors import one_line
from gcs.video.frame import Image
from tracker.box import Box, TrackResult

log = logging.getLogger(__name__)


class BoxTracker(Protocol):
    """`tracker.online.ClimRTTracker`, or a stand-in of a test."""

    def init(self, frame_bgr: Image, box: Box) -> None:
        """Take what is in the box; ValueError for a box that cannot be tracked."""
        ...

    def update(self, frame_bgr: Image) -> TrackResult:
        """Where it is in the next frame."""
        ...

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """Where to look for it in the next frame, after an update that found it hidden."""
        ...


@runtime_checkable
class Learner(Protocol):
    """A tracker that learns from a frame; it does so before the next update, or sooner, when asked."""

    def learn(self) -> None:
        """Now, while nobody waits for it."""
        ...


def make_tracker(config: TrackerConfig, say: Callable[[str], object] = log.info) -> BoxTracker:
    """The configured tracker, weights loaded; what the configuration leaves open is chosen, and said.

    Raises tracker.weights.WeightsError, tracker.engines.engine.EngineError, one line.
    """
    # PyTorch costs seconds and hundreds of MB: only here, when a tracker is really wanted.
    from gcs.engine_choice.choice import applied, choose_anew, chosen
    from tracker.engines.engine import EngineError

    cv2.setNumThreads(1)  # what it does for a picture is little; its pool would take cores from engine and decoder
    decided = chosen(config, say)
    try:
        tracker = _loaded(decided)
    except (EngineError, RuntimeError, ImportError) as error:
        if config.engine is not None:
            raise
        say(f"tracker: what was best here no longer runs: {one_line(error)}")
        tracker = _loaded(applied(config, choose_anew(config, say)[1].candidate))
    something = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    tracker.init(something, Box(320.0, 240.0, 48.0, 48.0))  # else the first selection is what waits for PyTorch
    tracker.update(something)
    return tracker


def _loaded(config: TrackerConfig) -> BoxTracker:
    """By a configuration that leaves nothing open."""
    from tracker.configs import LatentProvider
    from tracker.weights import load_tracker

    assert config.weights is not None
    assert config.engine is not None
    latent = None if config.latent is None else LatentProvider(config.latent.value)
    return load_tracker(
        config.weights, latent=latent, latent_interval=config.latent_interval, threads=config.threads,
        engine=config.engine.value, graphs=config.graphs,
    )  # fmt: skip
