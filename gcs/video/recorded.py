"""Recorded video: every frame in order, with the video's own times. Nothing here looks at a clock."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from gcs.errors import VideoError
from gcs.video.frame import Decoded, Decoder, Frame, check_size

DEFAULT_FPS = 30.0
IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff"})
# Containers without an index guess their frame count from the duration: a few frames off is no truncation.
TRUNCATION_SLACK_FRAMES = 2
TRUNCATION_SLACK_FRAC = 0.02
_PNG = b"\x89PNG\r\n\x1a\n"


class RecordedSource:
    """A file or folder behind the `VideoSource` protocol. Raises VideoError if it holds not one frame."""

    is_live = False

    def __init__(self, name: str, decoder: Decoder) -> None:
        self.name = name
        self._decoder = decoder
        self.frame_count = decoder.frame_count
        self.fps: float | None = decoder.fps
        self.ended = False
        self.problem: str | None = None
        self._next_seq = 0
        self._last_t_s = -1.0
        self._first_pts_s: float | None = None
        first = self._decode()
        if first is None:
            decoder.close()
            raise VideoError(self.problem or f"{name}: not a single frame could be read")
        self._first: Decoded | None = first
        self.size: tuple[int, int] = (first.image_bgr.shape[1], first.image_bgr.shape[0])

    def read(self, timeout_s: float | None = None) -> Frame | None:
        if self.ended:
            return None
        decoded, self._first = (self._first, None) if self._first else (self._decode(), None)
        if decoded is None:
            self._end()
            return None
        size = (decoded.image_bgr.shape[1], decoded.image_bgr.shape[0])
        if size != self.size:
            wanted = f"{self.size[0]}x{self.size[1]}"
            self.problem = f"{self.name}: frame {self._next_seq} is {size[0]}x{size[1]} px, not {wanted} as the first"
            self.ended = True
            return None
        t_s = self._time_of(decoded)
        frame = Frame(self._next_seq, decoded.image_bgr, t_s, t_s)
        self._next_seq += 1
        return frame

    def _decode(self) -> Decoded | None:
        try:
            return self._decoder.read()
        except VideoError as error:
            self.problem = f"{error} (after {self._next_seq} frames)"
            return None

    def _time_of(self, decoded: Decoded) -> float:
        """Seconds since the first frame, strictly rising even where a container's time stamps are not."""
        period_s = 1.0 / (self.fps or DEFAULT_FPS)
        if decoded.pts_s is None:
            t_s = self._next_seq * period_s
        else:
            if self._first_pts_s is None:
                self._first_pts_s = decoded.pts_s
            t_s = decoded.pts_s - self._first_pts_s
        if t_s <= self._last_t_s:
            t_s = self._last_t_s + period_s
        self._last_t_s = t_s
        return t_s

    def _end(self) -> None:
        self.ended = True
        if self.frame_count is None or self.problem is not None:
            return
        missing = self.frame_count - self._next_seq
        if missing > max(TRUNCATION_SLACK_FRAMES, TRUNCATION_SLACK_FRAC * self.frame_count):
            self.problem = f"{self.name}: truncated, only {self._next_seq} of {self.frame_count} frames are there"

    def close(self) -> None:
        self.ended = True
        self._decoder.close()


def _chunks_fit(path: Path) -> bool:
    """False for a PNG whose chunks claim more bytes than there are: OpenCV would take gigabytes for one."""
    length = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(_PNG)) != _PNG:
            return True
        while len(head := file.read(8)) == 8:
            end = file.tell() + int.from_bytes(head[:4], "big") + 4
            if end > length:
                return False
            file.seek(end)
    return True


class FolderDecoder:
    """The images of a folder in the order of their names, at a given rate."""

    def __init__(self, folder: Path, fps: float | None = None) -> None:
        self._name = str(folder)
        self.fps: float | None = fps or DEFAULT_FPS
        self._paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        if not self._paths:
            raise VideoError(f"{folder}: no images in this folder")
        self.frame_count: int | None = len(self._paths)
        self._at = 0

    def read(self) -> Decoded | None:
        if self._at >= len(self._paths):
            return None
        path = self._paths[self._at]
        self._at += 1
        try:
            sane = _chunks_fit(path)
            image = cv2.imread(str(path), cv2.IMREAD_COLOR) if sane else None
        except OSError as error:
            raise VideoError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        except cv2.error as error:
            raise VideoError(f"{path}: cannot be decoded") from error
        if image is None:
            raise VideoError(f"{path}: not an image")
        check_size(str(path), image.shape[1], image.shape[0])
        return Decoded(np.asarray(image, dtype=np.uint8))

    def close(self) -> None:
        self._at = len(self._paths)
