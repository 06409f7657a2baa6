"""The film of a flight with the overlay drawn in, made from its record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Protocol

import cv2
import numpy as np

from gcs import hud
from gcs.cli.progress import shown_progress
from gcs.dryrun.output import AnnotatedVideo
from gcs.errors import GcsError
from gcs.flight_view import overlay
from gcs.recorder.events import Ordered, Said
from gcs.replay.log import FrameRow
from gcs.replay.recorded import SHOWN, Recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import tells_state, words_of
from gcs.video.frame import Image

_SAID_S: Final = 4.0
_USUAL_FPS: Final = 20.0
_TICKS_HZ: Final = 90_000
_QUALITY: Final = {"preset": "veryfast", "crf": "23"}


class FilmError(GcsError):
    """A film that cannot be made; names the file."""


class _Writer(Protocol):
    def write(self, image_bgr: Image, t_s: float) -> None: ...

    def close(self) -> None: ...


def write_film(recorded: Recorded, path: Path) -> str:
    """Every picture at its time, so that a pause is one; what was written, in one line. Raises FilmError."""
    if path.suffix.lower() != ".mp4":
        raise FilmError(f"--film {path}: the name must end in .mp4")
    if not recorded.film.is_there:
        raise FilmError(recorded.film.problem or "no film in it")
    if recorded.film.is_annotated:
        raise FilmError(f"{recorded.log.path.parent}: the film of a dry run has the overlay drawn in already")
    make: Callable[[Path, tuple[int, int]], _Writer] = _Mp4v if find_spec("av") is None else _H264
    writer = make(path, recorded.film.size)
    try:
        pictures = _draw(recorded, writer)
    finally:
        writer.close()
    codec = "MPEG-4 part 2; for browsers install climrt-gcs[video]" if make is _Mp4v else "H.264"
    return f"{path}: {pictures} pictures ({codec})"


def _draw(recorded: Recorded, writer: _Writer) -> int:
    station = ReplayStation(recorded)
    watermark = (recorded.manifest.watermark if recorded.manifest is not None else None) or station.watermark
    first_s: float | None = None
    said, said_s, pictures = "", -_SAID_S, 0
    total = len(recorded.log.places(*SHOWN))
    for moment in shown_progress(recorded.moments(), "film", "messages", total):
        sighting = station.took(moment)
        if isinstance(moment.message, Ordered | Said) and not tells_state(moment.message):
            said, said_s = words_of(moment.message), moment.t_s
        if sighting is None or not isinstance(moment.message, FrameRow):
            continue
        drawn = overlay(sighting, watermark)
        if moment.t_s - said_s < _SAID_S:
            drawn = replace(drawn, lines=(*drawn.lines, f"> {said}"))
        first_s = moment.message.t_arrival_s if first_s is None else first_s
        writer.write(hud.draw(sighting.seen.frame.image_bgr, drawn), moment.message.t_arrival_s - first_s)
        pictures += 1
    return pictures


class _Mp4v:
    """What OpenCV brings along; players show it, browsers mostly do not."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self._file = AnnotatedVideo(path, size, _USUAL_FPS)
        self._check()

    def write(self, image_bgr: Image, t_s: float) -> None:
        self._file.write(image_bgr, t_s)
        self._check()

    def close(self) -> None:
        self._file.close()

    def _check(self) -> None:
        if self._file.problem is not None:
            raise FilmError(self._file.problem)


class _H264:
    """By PyAV, for browsers too; an odd last row or column is left out."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        import av  # an optional package: the module must import without it

        self._av: Any = av
        self._path, self._ticks = path, -1
        try:
            self._file: Any = av.open(str(path), "w", format="mp4", options={"movflags": "faststart"})
            self._stream: Any = self._file.add_stream("libx264", options=dict(_QUALITY))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise self._error(error) from error
        self._stream.width, self._stream.height = (side // 2 * 2 for side in size)
        self._stream.pix_fmt = "yuv420p"
        self._stream.time_base = self._stream.codec_context.time_base = Fraction(1, _TICKS_HZ)

    def write(self, image_bgr: Image, t_s: float) -> None:
        width, height = self._stream.width, self._stream.height
        planes = cv2.cvtColor(np.ascontiguousarray(image_bgr[:height, :width]), cv2.COLOR_BGR2YUV_I420)
        frame = self._av.VideoFrame.from_ndarray(planes, format="yuv420p")
        self._ticks = max(round(t_s * _TICKS_HZ), self._ticks + 1)
        frame.pts, frame.time_base = self._ticks, Fraction(1, _TICKS_HZ)
        self._put(frame)

    def close(self) -> None:
        """The file can be played from here on."""
        self._put(None)
        try:
            self._file.close()
        except (self._av.FFmpegError, OSError) as error:
            raise self._error(error) from error

    def _put(self, frame: Any) -> None:
        try:
            self._file.mux(self._stream.encode(frame))
        except (self._av.FFmpegError, OSError, ValueError) as error:
            raise self._error(error) from error

    def _error(self, error: Exception) -> FilmError:
        return FilmError(f"{self._path}: cannot be written: {getattr(error, 'strerror', None) or error}")
