"""A camera on the network: numbered pictures as MPEG-TS over UDP or as RTP, made with PyAV."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import numpy as np

from gcs.video.frame import Image

SIZE = (320, 240)
_BITS = 10
_ZEROLATENCY = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "repeat-headers=1"}


def free_port() -> int:
    """A UDP port (even, as RTP wants it, with a free one behind) that nobody has now."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
            if port % 2 == 0:
                return port


def numbered(number: int, size: tuple[int, int] = SIZE) -> Image:
    """A picture that tells its number by ten black or white blocks at its upper edge."""
    width, height = size
    image = np.full((height, width, 3), 90, np.uint8)
    side = width // _BITS
    for bit in range(_BITS):
        image[: height // 4, bit * side : (bit + 1) * side] = 235 if number >> bit & 1 else 20
    return image


def number_of(image: Image) -> int:
    """What `numbered` wrote, modulo 1024."""
    side = image.shape[1] // _BITS
    middle = image[image.shape[0] // 8, side // 2 :: side, 1][:_BITS]
    return sum(int(value > 128) << bit for bit, value in enumerate(middle))


def sdp(port: int, codec: str = "H264", payload: int = 96) -> str:
    """How a receiver of `StreamSender("rtp", port)` is told what comes."""
    return (
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=test\nc=IN IP4 127.0.0.1\nt=0 0\n"
        f"m=video {port} RTP/AVP {payload}\na=rtpmap:{payload} {codec}/90000\n"
    )


class StreamSender:
    """Sends from `with` on, every 1 / fps, one key frame in `gop`; `sent_s` tells when each number left."""

    def __init__(
        self,
        form: str,
        port: int,
        *,
        codec: str = "libx264",
        fps: float = 50.0,
        gop: int = 10,
        size: tuple[int, int] = SIZE,
        options: dict[str, str] | None = None,
        picture: Callable[[int, tuple[int, int]], Image] = numbered,
    ) -> None:
        """form: mpegts, rtp, or flv (TCP, one receiver). options: the encoder's.

        picture: makes each from its number and the size.
        """
        scheme, packet = ("udp", 1316) if form == "mpegts" else ("rtp", 1200)
        self._url, self._form = f"{scheme}://127.0.0.1:{port}?pkt_size={packet}", form
        self._listener = socket.create_server(("127.0.0.1", port)) if form == "flv" else None
        self._codec, self._fps, self._gop, self.size = codec, fps, gop, size
        self._options = {**(_ZEROLATENCY if codec == "libx264" else {}), **(options or {})}
        self._picture = picture
        self.sent_s: list[float] = []
        self.largest_bytes = 0  # of the encoded pictures
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> StreamSender:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        with contextlib.suppress(OSError):  # a receiver on TCP has gone
            self._send()
        if self._listener is not None:
            self._listener.close()

    def _send(self) -> None:
        import av

        to = self._url if self._listener is None else self._listener.accept()[0].makefile("wb", buffering=0)
        container = av.open(to, "w", format=self._form, options={"flush_packets": "1"})
        stream = container.add_stream(self._codec, rate=round(self._fps), options=self._options)
        stream.width, stream.height = self.size
        stream.pix_fmt, stream.gop_size = "yuv420p", self._gop
        due_s = time.monotonic()
        while not self._stop.wait(max(0.0, due_s - time.monotonic())):
            due_s += 1.0 / self._fps
            number = len(self.sent_s)
            frame = av.VideoFrame.from_ndarray(self._picture(number, self.size), format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, round(self._fps))
            self.sent_s.append(time.monotonic())
            for packet in stream.encode(frame):
                self.largest_bytes = max(self.largest_bytes, packet.size)
                container.mux(packet)
        container.close()


def write_sdp(path: Path, port: int, codec: str = "H264") -> Path:
    """An SDP file for `StreamSender("rtp", port)`."""
    path.write_text(sdp(port, codec))
    return path
