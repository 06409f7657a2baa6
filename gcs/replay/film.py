"""The film of a flight beside its messages: which picture belongs to which frame."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from gcs.dryrun.output import MAX_REPEATS
from gcs.dryrun.record import ANNOTATED
from gcs.errors import VideoError
from gcs.video import VideoSource, open_source
from gcs.video.frame import Image
from tracker.box import Box

VIDEO: Final = "flight.mp4"
_FPS: Final = 20.0
_SIZES_PX: Final = ((640, 480), (1280, 720), (1920, 1080), (3840, 2160))
_GREY: Final = 90


class Film:
    """Read forwards, on one thread. Where there is no film, its pictures are grey and `problem` says why."""

    def __init__(self, folder: Path) -> None:
        self.problem: str | None = None
        self.size: tuple[int, int] | None = None
        self._source: VideoSource | None = None
        self._fps = _FPS
        self._image: Image | None = None
        self._at = -1  # number of the picture held
        self._first_s: float | None = None
        self._due = self._written = 0
        path = next((folder / name for name in (VIDEO, ANNOTATED) if (folder / name).exists()), None)
        if path is None:
            self.problem = f"{folder}: no film in it, only messages"
            return
        try:
            self._source = open_source(str(path))
        except VideoError:
            self.problem = f"{path}: cannot be played; a flight that was broken off leaves no end in it"
            return
        self.size, self._fps = self._source.size, self._source.fps or _FPS

    @property
    def is_there(self) -> bool:
        """Whether there are pictures, with the overlay drawn in."""
        return self._source is not None

    def assume_size(self, boxes: Iterable[Box]) -> None:
        """Without a film: a usual size that has room for what was tracked."""
        right_px = bottom_px = 0.0
        for box in boxes:
            right_px, bottom_px = max(right_px, box.cx_px), max(bottom_px, box.cy_px)
        self.size = next((size for size in _SIZES_PX if right_px < size[0] and bottom_px < size[1]), _SIZES_PX[-1])

    def note(self, t_arrival_s: float) -> None:
        """A frame was written, as `AnnotatedVideo` counts: a pause repeats a picture, but not for ever."""
        if self._first_s is None:
            self._first_s = t_arrival_s
        due = round((t_arrival_s - self._first_s) * self._fps) + 1
        self._written += min(max(due - self._due, 0), MAX_REPEATS)
        self._due = max(due, self._due)

    def picture(self) -> Image:
        """Of the frame last noted; the last there is where the film is shorter."""
        while self._source is not None and self._at < self._written - 1:
            frame = self._source.read()
            if frame is None:
                break
            self._image, self._at = frame.image_bgr, self._at + 1
        if self._image is None:
            width_px, height_px = self.size or _SIZES_PX[0]
            self._image = np.full((height_px, width_px, 3), _GREY, np.uint8)
        return self._image

    def close(self) -> None:
        """Close the file."""
        if self._source is not None:
            self._source.close()
