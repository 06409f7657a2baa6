"""Small generated clips: a bright textured square moving to the right over grey noise."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

SIZE = (320, 240)  # width, height
SIDE_PX = 32
STEP_PX = 2.0
START_XY = (60.0, 90.0)

Picture = npt.NDArray[np.uint8]


def box_at(index: int) -> tuple[float, float, float, float]:
    """Ground truth (x, y, w, h) in px of frame `index`."""
    return (START_XY[0] + STEP_PX * index, START_XY[1], float(SIDE_PX), float(SIDE_PX))


def picture(index: int) -> Picture:
    """Frame `index` of the clip, BGR."""
    rng = np.random.default_rng(7)
    image = rng.integers(90, 120, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    x, y = int(box_at(index)[0]), int(box_at(index)[1])
    image[y : y + SIDE_PX, x : x + SIDE_PX] = (40, 60, 220)
    image[y + 8 : y + 24, x + 8 : x + 24] = (240, 240, 60)
    return image


def write_clip(path: Path, frames: int = 20, fps: float = 20.0) -> Path:
    """Write the clip as mp4 (index at the end, as cameras do) or, by suffix, another container."""
    fourcc = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix == ".avi" else "mp4v"))
    writer = cv2.VideoWriter(str(path), fourcc, fps, SIZE)
    assert writer.isOpened()
    for index in range(frames):
        writer.write(picture(index))
    writer.release()
    return path


def write_folder(folder: Path, frames: int = 10) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(frames):
        cv2.imwrite(str(folder / f"{index:06d}.png"), picture(index))
    return folder


def write_truth(path: Path, frames: int) -> Path:
    path.write_text("".join("{},{},{},{}\n".format(*box_at(i)) for i in range(frames)))
    return path


def index_first(path: Path) -> Path:
    """The same mp4 with its index (moov) moved to the front, so that cutting its end leaves frames to read."""
    data = path.read_bytes()
    atoms, at = [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        atoms.append((data[at + 4 : at + 8], data[at : at + size]))
        at += size
    parts = dict(atoms)
    moov = _shifted(parts[b"moov"], len(parts[b"moov"]))
    head = b"".join(body for kind, body in atoms if kind not in (b"moov", b"mdat"))
    # Offsets count from the file's start: everything before mdat but moov stays where it was.
    out = path.with_name("front_" + path.name)
    out.write_bytes(head + moov + parts[b"mdat"])
    return out


def _shifted(moov: bytes, by: int) -> bytes:
    """`moov` with all chunk offsets (stco) moved by `by` bytes."""
    data, at = bytearray(moov), moov.find(b"stco")
    assert at > 0
    count = int.from_bytes(data[at + 8 : at + 12], "big")
    for entry in range(at + 12, at + 12 + 4 * count, 4):
        value = int.from_bytes(data[entry : entry + 4], "big") + by
        data[entry : entry + 4] = value.to_bytes(4, "big")
    return bytes(data)
