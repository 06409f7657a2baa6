"""The film of a flight beside its messages: which picture belongs to which frame."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from gcs.dryrun.output import ANNOTATED, MAX_REPEATS
from gcs.errors import VideoError
from gcs.recorder.film_index import INDEX
from gcs.recorder.film_reader import FilmReader
from gcs.replay.log import Entry, FlightLog, FrameRow
from gcs.video import VideoSource, open_source
from gcs.video.frame import Image

_FPS: Final = 20.0
_SIZES_PX: Final = ((640, 480), (1280, 720), (1920, 1080), (3840, 2160))
_GREY: Final = 90
_LOOKED_AT: Final = 2000  # messages, for the size of pictures that are not there


class Film:
    """Pictures by the frames of the log, quickest when asked for in their order; not to be shared between threads.

    size: (width, height) of the pictures, px.
    """

    def __init__(self, folder: Path, log: FlightLog | None = None) -> None:
        """log: of the same folder; the film of a dry run needs it, and so does a guess at the size of none."""
        is_annotated = (folder / ANNOTATED).exists() and not (folder / INDEX).exists()  # a replay may have made it
        self._annotated = _Annotated(folder / ANNOTATED, log) if is_annotated else None
        self._film = FilmReader(folder) if self._annotated is None else None
        known = (self._annotated or self._film).size  # type: ignore[union-attr]
        self.is_there = known is not None
        self.size: tuple[int, int] = known or _assumed_size(log or ())

    @property
    def problem(self) -> str | None:
        """Why there is no film, or not all of it, in one line."""
        part = self._annotated or self._film
        return None if part is None else part.problem

    @property
    def is_annotated(self) -> bool:
        """Whether the overlay is drawn in already, as in the film of a dry run."""
        return self._annotated is not None and self.is_there

    @property
    def is_exact(self) -> bool:
        """Whether its pictures are those that were tracked, to the last bit."""
        return self._film is not None and self._film.is_exact

    def picture(self, row: FrameRow) -> Image | None:
        """What was tracked; None where it was not filmed."""
        if self._annotated is not None:
            return self._annotated.picture_at(row.t_arrival_s)
        return None if row.packet is None or self._film is None else self._film.picture(row.packet)

    def picture_of(self, row: FrameRow) -> Image:
        """The same for the eye: grey where it was not filmed."""
        image_bgr = self.picture(row)
        if image_bgr is None:
            width_px, height_px = self.size
            image_bgr = np.full((height_px, width_px, 3), _GREY, np.uint8)
        return image_bgr

    def close(self) -> None:
        """Close the files."""
        for part in (self._annotated, self._film):
            if part is not None:
                part.close()


def _assumed_size(log: Iterable[Entry]) -> tuple[int, int]:
    """Without a film: a usual size that has room for what was tracked."""
    right_px = bottom_px = 0.0
    for _, _, message in islice(log, _LOOKED_AT):
        if isinstance(message, FrameRow) and (result := message.tracked) is not None:
            right_px, bottom_px = max(right_px, result.box.cx_px), max(bottom_px, result.box.cy_px)
    return next((size for size in _SIZES_PX if right_px < size[0] and bottom_px < size[1]), _SIZES_PX[-1])


class _Annotated:
    """The mp4 of a dry run; it counts as `AnnotatedVideo` does: a pause repeats a picture, but not for ever."""

    def __init__(self, path: Path, log: FlightLog | None) -> None:
        self._path = path
        self.problem: str | None = None
        self.size: tuple[int, int] | None = None
        self._source: VideoSource | None = None
        self._image: Image | None = None
        self._at = -1  # number of the picture held
        self._numbers: dict[float, int] = {}  # of the picture, by the frame's arrival time
        try:
            source = self._open()
        except VideoError:
            self.problem = f"{path}: cannot be played; a dry run that was broken off leaves no end in it"
            return
        self.size = source.size
        times_s = (message.t_arrival_s for _, _, message in log or () if isinstance(message, FrameRow))
        self._numbers = _numbers(times_s, source.fps or _FPS)

    def _open(self) -> VideoSource:
        self.close()
        self._source, self._at = open_source(str(self._path)), -1
        return self._source

    def picture_at(self, t_arrival_s: float) -> Image | None:
        """Of the frame that came then; the last there is where the film is shorter."""
        number = self._numbers.get(t_arrival_s)
        if number is None or self._source is None:
            return None
        source = self._open() if number < self._at else self._source
        while self._at < number:
            frame = source.read()
            if frame is None:
                break
            self._image, self._at = frame.image_bgr, self._at + 1
        return self._image

    def close(self) -> None:
        if self._source is not None:
            self._source.close()


def _numbers(times_s: Iterable[float], fps: float) -> dict[float, int]:
    numbers: dict[float, int] = {}
    first_s: float | None = None
    due = written = 0
    for t_s in times_s:
        first_s = t_s if first_s is None else first_s
        now_due = round((t_s - first_s) * fps) + 1
        written += min(max(now_due - due, 0), MAX_REPEATS)
        due = max(now_due, due)
        numbers[t_s] = max(written - 1, 0)
    return numbers
