"""PyAV's reader, an optional extra: one frame less of delay on streams, and it says why something failed."""

from __future__ import annotations

import time
from importlib.util import find_spec
from typing import Any

import numpy as np

from gcs.errors import VideoError
from gcs.video.frame import OPEN_TIMEOUT_S, Decoded, check_size, nominal_fps, redact

# Joining a stream between two key frames, the decoder refuses everything up to the next one.
MAX_BAD_PACKETS = 300
LIVE_OPTIONS = {
    "rtsp_transport": "tcp",
    "fflags": "nobuffer",
    "flags": "low_delay",
    "probesize": "200000",
    "analyzeduration": "500000",
}


def is_installed() -> bool:
    """Whether `pip install climrt-gcs[video]` was done."""
    return find_spec("av") is not None


class AvDecoder:
    """One PyAV container, single-threaded decoding (frame threads cost a frame of delay each)."""

    def __init__(self, address: str, *, live: bool) -> None:
        import av  # an optional package: the module must import without it

        self._av: Any = av
        self._name = redact(address)
        av.logging.set_libav_level(av.logging.PANIC)  # its reasons come as exceptions, not on the screen
        try:
            self._container: Any = av.open(
                address, options=LIVE_OPTIONS if live else {}, timeout=(OPEN_TIMEOUT_S, OPEN_TIMEOUT_S)
            )
        except (av.FFmpegError, OSError, ValueError) as error:
            raise VideoError(f"{self._name}: {_reason(error)}") from error
        try:
            self._stream: Any = self._video_stream()
        except VideoError:
            self._container.close()
            raise
        self._stream.codec_context.thread_count = 1
        self._packets = iter(self._container.demux(self._stream))
        self._waiting: list[Any] = []
        self._arrived_s = 0.0  # the packet that gave them

    def _video_stream(self) -> Any:
        streams = self._container.streams.video
        if not streams or streams[0].codec_context is None:  # None: a codec that FFmpeg does not know
            raise VideoError(f"{self._name}: holds no video")
        check_size(self._name, streams[0].codec_context.width, streams[0].codec_context.height)
        return streams[0]

    @property
    def fps(self) -> float | None:
        return nominal_fps(float(self._stream.average_rate or 0.0))

    @property
    def frame_count(self) -> int | None:
        return self._stream.frames or None

    def read(self) -> Decoded | None:
        while not self._waiting:
            if not self._decode_packet():
                return None
        frame = self._waiting.pop(0)
        check_size(self._name, frame.width, frame.height)
        image_bgr = np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8)
        return Decoded(image_bgr, frame.time, time.monotonic() - self._arrived_s)

    def _decode_packet(self) -> bool:
        """Decode until a packet gives frames; False at the end. Raises VideoError on a run of bad packets."""
        for _ in range(MAX_BAD_PACKETS):
            try:
                packet = next(self._packets)
                self._arrived_s = time.monotonic()
                self._waiting = list(packet.decode())
                return True
            except (StopIteration, self._av.EOFError):
                return False
            except self._av.InvalidDataError:
                continue
            except (self._av.FFmpegError, OSError) as error:
                raise VideoError(f"{self._name}: {_reason(error)}") from error
        raise VideoError(f"{self._name}: {MAX_BAD_PACKETS} unreadable packets in a row")

    def close(self) -> None:
        self._container.close()


def _reason(error: Exception) -> str:
    strerror = getattr(error, "strerror", None)
    return str(strerror or error).splitlines()[0].lower()
