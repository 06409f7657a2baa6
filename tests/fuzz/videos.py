"""Damaged video: small files, folders and streams, and what may be wrong with them. Each is told by its number."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

import cv2
import numpy as np

WIDTH_PX, HEIGHT_PX, FRAMES = 64, 48, 10
_PICTURES: Final = 3


class Medium(Enum):
    """What is damaged, and how it is opened."""

    MP4 = "mp4"
    AVI = "avi"  # MJPEG in it
    FOLDER = "folder"
    MJPEG = "http, multipart"
    TS = "http, transport stream"


@dataclass(frozen=True, slots=True)
class Seeds:
    """Whole ones to damage."""

    mp4: bytes
    avi: bytes
    ts: bytes
    jpeg: bytes
    png: bytes

    @classmethod
    def make(cls, folder: Path) -> Seeds:
        """Written by OpenCV, and the transport stream by PyAV."""
        pictures = [_picture(number) for number in range(FRAMES)]
        files = {"a.mp4": "mp4v", "a.avi": "MJPG"}
        for name, code in files.items():
            writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*code), 20.0, (WIDTH_PX, HEIGHT_PX))
            for picture in pictures:
                writer.write(picture)
            writer.release()
        return cls(
            (folder / "a.mp4").read_bytes(),
            (folder / "a.avi").read_bytes(),
            _transport_stream(folder / "a.ts", pictures),
            cv2.imencode(".jpg", pictures[0])[1].tobytes(),
            cv2.imencode(".png", pictures[0])[1].tobytes(),
        )


def _picture(number: int) -> np.ndarray:
    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), 40, np.uint8)
    cv2.circle(picture, (8 + 5 * number, 24), 7, (30, 200, 90 + 10 * number), -1)
    return picture


def _transport_stream(path: Path, pictures: list[np.ndarray]) -> bytes:
    import av

    with av.open(str(path), "w", format="mpegts") as out:
        stream = out.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        for picture in pictures * 3:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        out.mux(stream.encode())
    return path.read_bytes()


def damage(rng: random.Random, data: bytes) -> bytes:
    """One or several kinds of damage."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(_DAMAGES)(rng, data) or b"\0"
    return data


def _flip(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 4, 16, 200))):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _flip_head(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 2, 8))):
        changed[rng.randrange(min(len(changed), 400))] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
    return bytes(changed)


def _cut(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(1, len(data) + 1)]


def _take_out(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.choice((1, 7, 64, 1000)) :]


def _put_in(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + rng.randbytes(rng.choice((1, 8, 500))) + data[at:]


def _double(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data))
    part = data[start : start + rng.choice((16, 200, 4000))]
    return data[:start] + part * rng.choice((2, 3, 20)) + data[start:]


def _number(rng: random.Random, data: bytes) -> bytes:
    """An absurd number where some length, size or count may stand."""
    at = rng.randrange(len(data))
    order = rng.choice("<>")
    number = struct.pack(f"{order}I", rng.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 65535, 1 << 24)))
    return data[:at] + number + data[at + 4 :]


def _size(rng: random.Random, data: bytes) -> bytes:
    """An absurd width or height, wherever the true one stands as two bytes."""
    order = rng.choice(("little", "big"))
    old = rng.choice((WIDTH_PX, HEIGHT_PX)).to_bytes(2, order)
    new = rng.choice((0, 1, 4097, 8192, 16384, 32767, 65535)).to_bytes(2, order)
    return data.replace(old, new, rng.choice((1, 2, 100)))


def _noise(rng: random.Random, data: bytes) -> bytes:
    return rng.randbytes(rng.choice((1, 16, 1000, 20_000)))


_DAMAGES: Final = (
    _flip,
    _flip,
    _flip_head,
    _flip_head,
    _cut,
    _take_out,
    _put_in,
    _double,
    _number,
    _size,
    _size,
    _noise,
)


def whole(seeds: Seeds, medium: Medium) -> bytes:
    """What is damaged: of a folder the first picture; of a stream everything after the HTTP head."""
    match medium:
        case Medium.MP4:
            return seeds.mp4
        case Medium.AVI:
            return seeds.avi
        case Medium.TS:
            return seeds.ts
        case Medium.MJPEG:
            part = b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(seeds.jpeg)
            return (part + seeds.jpeg + b"\r\n") * FRAMES
        case Medium.FOLDER:
            return seeds.jpeg


def write_folder(folder: Path, rng: random.Random, seeds: Seeds) -> Path:
    """Three pictures, of which one is damaged or of another kind than its name says."""
    folder.mkdir()
    for number in range(_PICTURES):
        name = f"{number}.{rng.choice(('jpg', 'png'))}"
        data = rng.choice((seeds.jpeg, seeds.png))
        (folder / name).write_bytes(data if number != rng.randrange(_PICTURES) else damage(rng, data))
    return folder
