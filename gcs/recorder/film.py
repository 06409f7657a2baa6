"""The film of a flight: what the camera sent, as it came, on a thread of its own that may fail alone."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import cv2

from gcs.recorder.film_files import FilmFiles
from gcs.recorder.film_index import SUFFIXES
from gcs.video.frame import Image
from gcs.video.tap import Coding, Library

HELD_BYTES: Final = 64 * 1024 * 1024
_WRITE_S: Final = 0.2  # so often, many at once: waking up for each costs more than they do
_CLOSE_S: Final = 5.0
_JPEG_QUALITY: Final = 95
_PICTURES: Final = Coding("mjpeg", Library.OPENCV)

log = logging.getLogger(__name__)


@dataclass(slots=True)
class FilmSwitch:
    """on: the operator's."""

    on: bool = True


@dataclass(frozen=True, slots=True)
class _Opened:
    coding: Coding
    lossy: bool

    nbytes = 0


@dataclass(frozen=True, slots=True)
class _Packet:
    number: int
    data: bytes
    t_arrival_s: float
    is_key: bool
    skips: bool

    @property
    def nbytes(self) -> int:
        return len(self.data)


@dataclass(frozen=True, slots=True)
class _Picture:
    number: int
    image_bgr: Image
    t_arrival_s: float

    @property
    def nbytes(self) -> int:
        return int(self.image_bgr.nbytes)


_Item = _Opened | _Packet | _Picture


class Film(FilmSwitch):
    """A `Tap` of the video source. The files, made with the first packet, are those of `gcs.recorder.film_index`.

    Switched off and on again it goes on with the next key frame, and so it does where the disk was too slow: what did
    not fit into `held_bytes` is left out and counted in `dropped`. A disk error ends it; `problem` says why.
    """

    def __init__(
        self,
        folder: Path,
        *,
        held_bytes: int = HELD_BYTES,
        open_file: Callable[[Path], IO[bytes]] = lambda path: path.open("wb"),
    ) -> None:
        """folder must exist."""
        super().__init__()
        self.dropped = 0
        self.problem: str | None = None
        self._folder, self._most_bytes, self._open_file = folder, held_bytes, open_file
        self._lock = threading.Lock()
        self._waiting: deque[_Item] = deque()
        self._held_bytes = 0
        self._next_number = 0
        self._stream: _Opened | None = None
        self._is_whole = False  # what came last on this connection is in it, so that what comes next can follow
        self._has_failed = self._is_closed = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None

    def opened(self, coding: Coding) -> bool:
        """See `Tap`."""
        with self._lock:
            self._is_whole = False
            if coding.codec not in SUFFIXES:
                self._stream = None
                self.problem = self.problem or f"{self._folder}: no film of {coding.codec} as it came, only as JPEG"
                return False
            self._stream = _Opened(coding, lossy=False)
            self._is_whole = self._put(self._stream)
            return True

    def packet(self, data: bytes, t_arrival_s: float, *, is_key: bool, skips: bool = False) -> int:
        """See `Tap`."""
        with self._lock:
            number = self._count()
            if not self.on:
                self._is_whole = False
            elif self._is_whole or is_key:
                self._is_whole = self._put(_Packet(number, data, t_arrival_s, is_key, skips))
            return number

    def picture(self, image_bgr: Image, t_arrival_s: float) -> int:
        """See `Tap`; kept as JPEG, so what was tracked is nearly, not exactly in the film."""
        with self._lock:
            number = self._count()
            if self.on and (self._stream is None or not self._stream.lossy):
                self._stream = _Opened(_PICTURES, lossy=True)
                self._put(self._stream)
            if self.on:
                self._put(_Picture(number, image_bgr, t_arrival_s))
            return number

    def close(self) -> None:
        """Finish the files, within some seconds even where the disk is stuck."""
        with self._lock:
            self._is_closed = True
        self._wake.set()
        if self._thread is None:
            return
        self._thread.join(_CLOSE_S)
        if self._thread.is_alive() and not self._has_failed:
            self._give_up("the disk does not answer")

    def _count(self) -> int:
        self._next_number += 1
        return self._next_number - 1

    def _put(self, item: _Item) -> bool:
        """Queue it, where there is room."""
        if self._is_closed:
            return False
        if self._has_failed or self._held_bytes + item.nbytes > self._most_bytes:
            self.dropped += 1
            return False
        self._waiting.append(item)
        self._held_bytes += item.nbytes
        if self._held_bytes > self._most_bytes // 4:
            self._wake.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="film", daemon=True)
            self._thread.start()
        return True

    def _run(self) -> None:
        files = FilmFiles(self._folder, self._open_file)
        try:
            with files:
                while not self._is_closed:
                    self._wake.wait(_WRITE_S)
                    self._wake.clear()
                    self._write(files)
                self._write(files)
                files.sync()
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except (ValueError, cv2.error) as error:
            # A picture that cannot be encoded is a programming error, but not worth a flight.
            self._give_up(str(error))

    def _write(self, files: FilmFiles) -> None:
        with self._lock:
            items, self._waiting = self._waiting, deque()
        try:
            while items:
                item = items.popleft()
                _add(files, item)
                with self._lock:
                    self._held_bytes -= item.nbytes
            files.flush()
        except BaseException:
            with self._lock:
                self.dropped += len(items) + 1
            raise

    def _give_up(self, reason: str) -> None:
        with self._lock:
            self._has_failed = True
            self.problem = f"{self._folder}: the film ends here: {reason[:1].lower()}{reason[1:]}"
            self.dropped += len(self._waiting)
            self._waiting.clear()
        log.warning("%s", self.problem)


def _add(files: FilmFiles, item: _Item) -> None:
    match item:
        case _Opened(coding, lossy):
            files.begin(coding, lossy=lossy)
        case _Packet(number, data, t_arrival_s, is_key, skips):
            files.add(number, data, t_arrival_s, is_key=is_key, skips=skips)
        case _Picture(number, image_bgr, t_arrival_s):
            _, encoded = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
            files.add(number, encoded.tobytes(), t_arrival_s, is_key=True, skips=False)
