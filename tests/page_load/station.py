"""A station whose pictures cost nothing to make and look like video to a JPEG encoder."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import cv2
import numpy as np

from gcs.flight_view import Sighting
from tests.gcs.fake_station import FakeStation
from tracker.box import TrackResult

_KINDS = 10


def pictures(size: tuple[int, int], seed: int = 1) -> list[np.ndarray]:
    """Blurred noise over a gradient: about 1.5 bits a pixel as a JPEG of quality 75, as a drone's video has."""
    rng = np.random.default_rng(seed)
    width, height = size
    slope = np.linspace(60, 160, height, dtype=np.float32)[:, None, None]
    found = []
    for _ in range(_KINDS):
        noise = cv2.GaussianBlur(rng.normal(0, 60, (height, width, 3)).astype(np.float32), (0, 0), 1.2)
        found.append(np.clip(slope + noise, 0, 255).astype(np.uint8))
    return found


class LoadStation(FakeStation):
    """`run` gives one of a few ready pictures, tracked, at the asked rate; never behind by more than one."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._images = pictures(self.size)
        self._selected(self._target())

    def show(self) -> Sighting:
        self._seq += 1
        box = self._target()
        image, result = self._images[self._seq % _KINDS], TrackResult(box, 0.9, 0.87)
        return self._tell(image, result, replace(box, cx_px=box.cx_px + 4))

    async def run(self, fps: float = 20.0) -> None:
        due_s = self.now_s()
        while True:
            self.show()
            due_s = max(due_s + 1 / fps, self.now_s())
            await asyncio.sleep(due_s - self.now_s())
