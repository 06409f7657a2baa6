"""The packets of a live stream on their way from the network into the decoder, past whoever keeps them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from gcs.video.annex_b import is_annex_b, parameter_sets
from gcs.video.decoding import PacketDecoder
from gcs.video.packets import PacketQueue
from gcs.video.tap import Coding, Library, Tap

_UNPARSED: Final = frozenset({"h264", "mjpeg"})  # of MPEG-TS
_MOST_PES_BYTES: Final = 200 * 1024  # FFmpeg cuts larger pictures in pieces of this size (less a little)
_LEAST_PIECE_BYTES: Final = _MOST_PES_BYTES - 188


@dataclass(frozen=True, slots=True)
class Coded:
    """What the decoder was given; t_arrival_s: of its last byte. number: the tap's, None without one."""

    data: bytes
    t_arrival_s: float
    is_key: bool = False
    number: int | None = None


class LivePackets:
    """A queue, a decoder, and a tap between them."""

    def __init__(
        self,
        stream: Any,
        packets: Iterator[Any],
        finish: Callable[[], None],
        name: str,
        *,
        tap: Tap | None,
        is_unparsed: bool,
        is_mpegts: bool,
    ) -> None:
        """stream: PyAV's, with the packets it gives. is_unparsed: no parser was at them. Raises av.FFmpegError."""
        context = stream.codec_context
        codec, extradata = context.codec.canonical_name, bytes(context.extradata or b"")
        self._in_pieces = is_unparsed and is_mpegts and codec in _UNPARSED
        self._piece, self._piece_is_key = b"", False
        self._filter: Any = None
        if not is_annex_b(codec, extradata):
            self._filter = _to_annex_b(codec, stream)
            extradata = parameter_sets(codec, extradata)
        parses = is_unparsed and not self._in_pieces
        coding = Coding(codec, Library.FFMPEG, extradata, context.reorder_depth, parses, self._in_pieces)
        self._decoder = PacketDecoder(coding)
        self._tap = tap if tap is not None and tap.opened(coding) else None
        self.queue = PacketQueue(packets, finish, name, codec)

    def decode_next(self) -> tuple[Coded, list[Any]]:
        """Wait for a packet; the PyAV frames it completes. Raises as `PacketQueue.get` and `PacketDecoder.decode`."""
        skips = self.queue.is_behind
        packet, arrived_s, is_key = self.queue.get()
        if self._filter is not None and packet.size:
            data = b"".join(bytes(each) for each in self._filter.filter(packet))
        else:
            data = bytes(packet)
        if self._in_pieces:
            is_last = len(data) <= _LEAST_PIECE_BYTES
            data, is_key = self._piece + data, self._piece_is_key or is_key
            self._piece, self._piece_is_key = (b"", False) if is_last else (data, is_key)
            if not is_last:
                return Coded(b"", arrived_s), []  # the rest of the picture comes
        number = None if self._tap is None else self._tap.packet(data, arrived_s, is_key=is_key, skips=skips)
        frames = self._decoder.decode(data, is_key=is_key, skips=skips)
        return Coded(data, arrived_s, is_key, number), frames


def _to_annex_b(codec: str, stream: Any) -> Any:
    from av.bitstream import BitStreamFilterContext

    return BitStreamFilterContext(f"{codec}_mp4toannexb", stream)
