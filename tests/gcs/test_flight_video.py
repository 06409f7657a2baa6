"""The annotated video of a flight, whose thread gets less time than it needs."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from gcs import flight_video, hud
from gcs.flight_video import FlightVideo
from gcs.video import open_source
from gcs.video.frame import Image

PICTURES, FPS = 30, 30.0


def grey(level: int) -> Image:
    return np.full((48, 64, 3), level, np.uint8)


def test_a_thread_that_comes_too_late_shortens_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    may_draw = threading.Event()

    def draw_late(image_bgr: Image, _: hud.Overlay) -> Image:
        may_draw.wait(10.0)
        return image_bgr

    monkeypatch.setattr(flight_video.hud, "draw", draw_late)
    film = FlightVideo(tmp_path / "late.mp4", (64, 48), FPS)
    overlay = hud.Overlay(state="IDLE", watermark="DRY RUN")
    for index in range(PICTURES):
        film.write(grey(8 * index), overlay, 5.0 + index / FPS)
    assert film.dropped >= PICTURES - 10
    may_draw.set()
    film.close()
    assert film.problem is None
    source = open_source(str(tmp_path / "late.mp4"))
    levels = []
    while (frame := source.read(1.0)) is not None:
        levels.append(float(frame.image_bgr.mean()))
    source.close()
    assert len(levels) == PICTURES
    assert levels[-1] == pytest.approx(8 * (PICTURES - 1), abs=12)
    assert levels[:5] == pytest.approx([0, 8, 16, 24, 32], abs=4)
