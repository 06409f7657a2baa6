"""`python -m tests.recorder.film_cost`: what filming costs the station, of one core, and the disk.

A camera in a process of its own, a live source here that decodes and shows each picture; with a film and without one
in turn, so that a busy machine is busy for both.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from gcs.recorder.film import Film
from gcs.video import open_source
from gcs.video.frame import Image
from tests.gcs.mjpeg_server import MjpegServer
from tests.gcs.stream_sender import StreamSender, free_port

_PICTURES = 40


@dataclass(frozen=True, slots=True)
class Camera:
    """form: mjpeg, or mpegts for H.264."""

    form: str
    width_px: int
    height_px: int
    fps: int

    def __str__(self) -> str:
        return f"{self.form} {self.width_px}x{self.height_px} at {self.fps}"


CAMERAS = (
    Camera("mjpeg", 640, 480, 20), Camera("mjpeg", 640, 480, 30), Camera("mjpeg", 1280, 720, 30),
    Camera("mpegts", 640, 480, 30), Camera("mpegts", 1280, 720, 30),
)  # fmt: skip


def scene(number: int, size: tuple[int, int]) -> Image:
    """About as hard to encode as a view of the ground."""
    coarse = np.random.default_rng(1).integers(0, 255, (size[1] // 16, size[0] // 16, 3), np.uint8)
    return np.roll(np.asarray(cv2.resize(coarse, size), np.uint8), 3 * (number % _PICTURES), axis=1)


def send(camera: Camera, port: int) -> None:
    """Until killed; says where."""
    size = (camera.width_px, camera.height_px)
    scenes = [scene(number, size) for number in range(_PICTURES)]
    if camera.form == "mpegts":
        with StreamSender(
            "mpegts", port, fps=camera.fps, gop=camera.fps, size=size,
            picture=lambda number, _: scenes[number % _PICTURES],
        ):  # fmt: skip
            sys.stdout.write(f"udp://127.0.0.1:{port}\n")
            sys.stdout.flush()
            time.sleep(3600.0)
    server = MjpegServer()
    pictures = [cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes() for image in scenes]
    sys.stdout.write(f"{server.url}\n")
    sys.stdout.flush()
    due_s, number = time.monotonic(), 0
    while True:
        due_s, number = due_s + 1 / camera.fps, number + 1
        time.sleep(max(0.0, due_s - time.monotonic()))
        if server.connections and server.parts.qsize() < 2:
            server.send_bytes(pictures[number % _PICTURES])


@contextmanager
def sender(camera: Camera) -> Iterator[str]:
    """The address of a camera that sends."""
    what = [camera.form, str(camera.width_px), str(camera.height_px), str(camera.fps), str(free_port())]
    process = subprocess.Popen(
        [sys.executable, "-m", __spec__.name, "--send", *what], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()


def cores(camera: Camera, folder: Path | None, seconds: float) -> tuple[float, float]:
    """CPU time of this process, and pictures, for each second."""
    film = None if folder is None else Film(folder)
    with sender(camera) as address:
        source = open_source(address, reconnect=False, tap=film)
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            source.read(1.0)
        used_s, start_s = time.process_time(), time.monotonic()
        frames = 0
        while time.monotonic() < start_s + seconds:
            frames += source.read(1.0) is not None
        used_s = time.process_time() - used_s
        source.close()
    if film is not None:
        film.close()
        assert (film.problem, film.dropped) == (None, 0)
    return used_s / seconds, frames / seconds


def main() -> None:
    """Print a line for each camera."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=6.0, help="of each run")
    parser.add_argument("--times", type=int, default=5, help="runs with and without")
    parser.add_argument("--send", nargs=5, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.send:
        form, *numbers = args.send
        width_px, height_px, fps, port = map(int, numbers)
        send(Camera(form, width_px, height_px, fps), port)
    progress = tqdm(total=len(CAMERAS) * args.times, disable=None)
    for camera in CAMERAS:
        with_film, without, written_bytes = [], [], 0
        for _ in range(args.times):
            with tempfile.TemporaryDirectory() as name:
                with_film.append(cores(camera, Path(name), args.seconds))
                written_bytes += sum(path.stat().st_size for path in Path(name).iterdir())
            without.append(cores(camera, None, args.seconds))
            progress.update()
        filming, shown = np.median(with_film, axis=0)
        decoding, _ = np.median(without, axis=0)
        per_minute = written_bytes / args.times / (args.seconds + 1.0) * 60
        progress.write(
            f"{camera!s:26} {shown:4.1f} pictures a second: decoding {decoding:.3f} of a core, "
            f"filming {filming - decoding:+.3f}; {per_minute / 1e6:.0f} MB a minute"
        )
    progress.close()


if __name__ == "__main__":
    main()
