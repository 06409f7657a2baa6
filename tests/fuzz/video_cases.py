"""One damaged video after the other through the real openers and readers; for `tests.fuzz.worker`."""

from __future__ import annotations

import math
import random
import shutil
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final

import cv2

from gcs.errors import VideoError, one_line
from gcs.video import open_source
from gcs.video.frame import MAX_AREA_PX, MAX_SIDE_PX
from tests.fuzz.process import Case, bad_line
from tests.fuzz.videos import Medium, Seeds, damage, whole, write_folder

_FRAMES: Final = 60  # at most so many are read of one
_READ_S: Final = 8.0  # a source gives up by itself after 5 s of silence
_MEDIA: Final = (Medium.MP4,) * 5 + (Medium.AVI,) * 4 + (Medium.FOLDER,) * 4 + (Medium.MJPEG,) * 5 + (Medium.TS,)


class VideoCases:
    """Files in `folder`, streams from a server in this process."""

    def __init__(self, folder: Path) -> None:
        cv2.setNumThreads(1)
        self._folder = folder
        self._seeds = Seeds.make(folder)
        self._server = _Server()

    def run(self, rng: random.Random) -> Case:
        """Damage one, open it, read it."""
        medium = rng.choice(_MEDIA)
        target = self._folder / f"v.{medium.name.lower()}"
        try:
            frames, said, problem = _open_and_read(_prepare(medium, rng, self._seeds, target, self._server))
        finally:
            shutil.rmtree(target, ignore_errors=True) if target.is_dir() else target.unlink(missing_ok=True)
        return Case(medium.value, bool(frames), said, problem)

    def close(self) -> None:
        """End the server."""
        self._server.close()


def _prepare(medium: Medium, rng: random.Random, seeds: Seeds, target: Path, server: _Server) -> str:
    if medium is Medium.FOLDER:
        return str(write_folder(target, rng, seeds))
    data = damage(rng, whole(seeds, medium))
    if medium in (Medium.MP4, Medium.AVI):
        target.write_bytes(data)
        return str(target)
    server.body = data
    server.kind = "multipart/x-mixed-replace; boundary=b" if medium is Medium.MJPEG else "video/mp2t"
    return server.url


def _open_and_read(address: str) -> tuple[int, str, str]:
    """(frames, what it said, what it must not have done)."""
    frames, last_s, deadline_s = 0, -math.inf, time.monotonic() + _READ_S
    try:
        source = open_source(address, reconnect=False)
    except VideoError as error:
        return 0, str(error), bad_line(str(error))
    except BaseException as error:  # noqa: BLE001 - this is what is looked for
        return 0, "", f"{type(error).__name__} leaves open_source: {one_line(error)}"
    try:
        while not source.ended and frames < _FRAMES and time.monotonic() < deadline_s:
            frame = source.read(0.5)
            if frame is None:
                continue
            frames += 1
            height, width = frame.image_bgr.shape[:2]
            if frame.image_bgr.dtype.name != "uint8" or frame.image_bgr.ndim != 3:
                return frames, "", f"a picture of {frame.image_bgr.dtype} {frame.image_bgr.shape}"
            if max(width, height) > MAX_SIDE_PX or width * height > MAX_AREA_PX:
                return frames, "", f"a picture of {width}x{height} px"
            if not (math.isfinite(frame.t_capture_s) and frame.t_capture_s > last_s):
                return frames, "", f"time {frame.t_capture_s} after {last_s}"
            last_s = frame.t_capture_s
        if time.monotonic() >= deadline_s:
            return frames, "", f"neither a frame nor an end within {_READ_S:g} s"
        said = source.problem or ""
        return frames, said, bad_line(said) if said else ""
    except BaseException as error:  # noqa: BLE001
        return frames, "", f"{type(error).__name__} leaves read: {one_line(error)}"
    finally:
        source.close()


class _Server:
    """Answers every request with `body` as `kind`, then closes."""

    body, kind = b"", ""

    def __init__(self) -> None:
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", outer.kind)
                self.end_headers()
                try:
                    self.wfile.write(outer.body)
                except OSError:  # the reader has had enough
                    return

            def log_message(self, *args: object) -> None:
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._http.server_address[1]}/"
        threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()

    def close(self) -> None:
        """No more answers."""
        self._http.shutdown()
        self._http.server_close()
