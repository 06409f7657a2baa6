"""PyAV's reader, an optional extra: least delay on streams, exact arrival times, and it says why something failed."""

from __future__ import annotations

import time
from importlib.util import find_spec
from typing import Any, Final

from gcs.errors import VideoError
from gcs.video.decoding import to_bgr
from gcs.video.frame import OPEN_TIMEOUT_S, SILENT_S, Decoded, check_size, nominal_fps, redact
from gcs.video.live_packets import Coded, LivePackets
from gcs.video.rtp import PROTOCOLS, as_opened, may_be_mpegts, rtsp_transport
from gcs.video.tap import Tap

# Joining a stream between two key frames, the decoder refuses everything up to the next one; some cameras send one
# in ten seconds.
FIRST_PICTURE_S: Final = 15.0
MAX_BAD_PACKETS: Final = 300
LIVE_OPTIONS: Final = {
    "rtsp_transport": "tcp",
    "flags": "low_delay",
    # FFmpeg would hold back up to a second of a stream while it guesses its rate. What it reads to find the format it
    # keeps (no `nobuffer`), so that the key frame in it is not lost.
    "fpsprobesize": "0",
    "analyzeduration": "100000",
    "probesize": "1000000",
    "overrun_nonfatal": "1",
    "protocol_whitelist": PROTOCOLS,
}
# FFmpeg's parser gives a picture only when the next one has begun. In MPEG-TS a packet is a whole picture already,
# and an H.264 decoder that takes slices as they come needs no parser. RTP's packets are pieces of pictures.
MPEGTS_OPTIONS: Final = {"fflags": "+noparse"}


def is_installed() -> bool:
    """Whether `pip install climrt-gcs[video]` was done."""
    return find_spec("av") is not None


class AvDecoder:
    """One PyAV container.

    Live: a thread of its own takes packets as they come, so arrival times are true and nothing queues in the network;
    of what has piled up while a picture was decoded, only the newest is given.
    """

    def __init__(self, address: str, *, live: bool, tap: Tap | None = None) -> None:
        """tap: of a live one, told of each packet that is decoded."""
        import av  # an optional package: the module must import without it

        self._av: Any = av
        self._name = redact(address)
        av.logging.set_libav_level(av.logging.PANIC)  # its reasons come as exceptions, not on the screen
        options = {**LIVE_OPTIONS, **rtsp_transport(address)} if live else {}
        if live and may_be_mpegts(address):
            options |= MPEGTS_OPTIONS
        try:
            self._container: Any = self._open(address, options)
        except av.InvalidDataError:
            del options["fflags"]  # H.264 as it is, not in MPEG-TS
            self._container = self._open(address, options)
        try:
            self._stream: Any = self._video_stream()
            self._context: Any = self._stream.codec_context
            self._context.thread_count = 1
            self._packets = iter(self._container.demux(self._stream))
            self._live = self._begin(tap, "fflags" in options) if live else None
        except VideoError:
            self._container.close()
            raise
        self._fps = nominal_fps(float(self._stream.average_rate or 0.0))
        self._waiting: list[Any] = []
        self._from = Coded(b"", 0.0)  # the packet that gave them

    def _begin(self, tap: Tap | None, is_unparsed: bool) -> LivePackets:
        is_mpegts = self._container.format.name == "mpegts"
        try:
            return LivePackets(
                self._stream, self._packets, self._container.close, self._name,
                tap=tap, is_unparsed=is_unparsed, is_mpegts=is_mpegts,
            )  # fmt: skip
        except (self._av.FFmpegError, ValueError) as error:
            raise VideoError(f"{self._name}: {_reason(error)}") from error

    def _open(self, address: str, options: dict[str, str]) -> Any:
        try:
            with as_opened(address) as opened:
                return self._av.open(opened, options=options, timeout=(OPEN_TIMEOUT_S, SILENT_S))
        except self._av.InvalidDataError:
            if "fflags" in options:
                raise
            raise VideoError(
                f"{self._name}: no video that can be read (another format, encrypted or damaged)"
            ) from None
        except (self._av.FFmpegError, OSError, ValueError) as error:
            raise VideoError(f"{self._name}: {_reason(error)}") from error

    def _video_stream(self) -> Any:
        streams = self._container.streams
        if not streams.video:
            held = sorted({f"{each.type} ({each.codec_context.name})" for each in streams if each.codec_context})
            raise VideoError(f"{self._name}: holds no video" + (f", only {', '.join(held)}" if held else ""))
        stream = streams.video[0]
        if stream.codec_context is None:
            raise VideoError(f"{self._name}: holds no video of a codec known here; use H.264")
        check_size(self._name, stream.codec_context.width, stream.codec_context.height)
        return stream

    @property
    def fps(self) -> float | None:
        return self._fps

    @property
    def frame_count(self) -> int | None:
        return self._stream.frames or None

    def read(self) -> Decoded | None:
        start_s = time.monotonic()
        while not self._waiting or (self._live is not None and self._live.queue.holds_from_before(start_s)):
            more = self._decode_packet()
            if not more and not self._waiting:
                return None
            if not more:
                break
            if self._live is not None and not self._waiting and time.monotonic() - start_s > FIRST_PICTURE_S:
                raise VideoError(
                    f"{self._name}: data comes, but no picture in {FIRST_PICTURE_S:.0f} s: it holds no key frame, "
                    "is encrypted or damaged"
                )
        frame = self._waiting.pop(0)
        check_size(self._name, frame.width, frame.height)
        image_bgr = to_bgr(frame)
        return Decoded(image_bgr, frame.time, time.monotonic() - self._from.t_arrival_s, self._from.number)

    def _decode_packet(self) -> bool:
        """Decode until a packet gives frames; False at the end. Raises VideoError on a run of bad packets.

        Of a live stream only the newest frame is left waiting.
        """
        for _ in range(MAX_BAD_PACKETS):
            try:
                if self._live is None:
                    coded, frames = Coded(b"", time.monotonic()), list(self._context.decode(next(self._packets)))
                else:
                    coded, frames = self._live.decode_next()
            except (StopIteration, self._av.EOFError):
                return False
            except self._av.InvalidDataError:
                continue
            except (self._av.FFmpegError, OSError) as error:
                raise VideoError(f"{self._name}: {_reason(error)}") from error
            if frames:
                self._from = coded
                self._waiting = frames if self._live is None else frames[-1:]
            return True
        raise VideoError(f"{self._name}: {MAX_BAD_PACKETS} unreadable packets in a row: encrypted or damaged")

    def close(self) -> None:
        """Of a live stream the thread that reads closes it, when its read comes back; nobody waits for long."""
        if self._live is not None:
            self._live.queue.close()
        else:
            self._container.close()


def _reason(error: Exception) -> str:
    """What FFmpeg says, in words that help."""
    strerror = getattr(error, "strerror", None)
    reason = str(strerror or error).splitlines()[0].lower()
    if reason.startswith("immediate exit"):
        return f"nothing came for {SILENT_S:.0f} s"
    if reason == "protocol not found":
        return "the FFmpeg that PyAV brings knows no such protocol"
    return reason
