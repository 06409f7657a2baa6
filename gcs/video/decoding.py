"""Packets to pictures with FFmpeg, the same for a live stream and for its film."""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np

from gcs.video.frame import Image
from gcs.video.tap import Coding

_HEAD_BYTES: Final = 64  # before it come but a delimiter and remarks
_KEYS: Final = {  # parameters, or a whole picture, begin
    "h264": re.compile(rb"\x00\x00\x01[\x25\x27\x45\x47\x65\x67]"),
    "hevc": re.compile(rb"\x00\x00\x01[\x26\x28\x2a\x40\x42]"),
}


def begins_anew(packet: Any, codec: str) -> bool:
    """Whether a decoder can begin with this packet; formats without a parser do not say so themselves."""
    pattern = _KEYS.get(codec)
    return bool(packet.is_keyframe) or (pattern is not None and pattern.search(bytes(packet)[:_HEAD_BYTES]) is not None)


class PacketDecoder:
    """One decoder, single-threaded (frame threads cost a frame of delay each).

    Its pictures follow from `coding` and the packets alone, whenever they are put in.
    """

    def __init__(self, coding: Coding) -> None:
        """Raises av.FFmpegError for a codec that this FFmpeg does not know."""
        import av  # an optional package: the module must import without it

        self._av: Any = av
        self._coding = coding
        self._context: Any = av.CodecContext.create(coding.codec, "r")
        self._context.thread_count = 1
        self._context.extradata = coding.extradata or None
        self._context.reorder_depth = coding.reorder_depth
        if coding.in_slices:
            self._context.flags2 |= int(av.codec.context.Flags2.chunks)

    def decode(self, data: bytes, *, is_key: bool, skips: bool) -> list[Any]:
        """The PyAV frames that this packet completes, see `Tap.packet`. Raises av.FFmpegError for a damaged one."""
        self._context.skip_frame = "NONREF" if skips else "DEFAULT"
        if self._coding.parses:
            return [frame for each in self._context.parse(data) for frame in self._context.decode(each)]
        if not data:
            return list(self._context.decode(None))
        packet = self._av.Packet(len(data))  # PyAV's own memory, with the zeros behind that FFmpeg may read
        packet.update(data)
        packet.is_keyframe = is_key
        return list(self._context.decode(packet))


def to_bgr(frame: Any) -> Image:
    """(height, width, 3) of a PyAV frame."""
    return np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8)
