"""The index of a film: which bytes of which file are which packet, and how each connection's packets are decoded.

`film.jsonl` holds a line for each connection and one for each packet, in the order in which a decoder was given them.
The bytes lie one after the other in `film.h264` and the like, which players take as they are; a camera that changes
its codec goes on in `film-2.h265`.
"""

from __future__ import annotations

from typing import Final

import msgspec

from gcs.recorder.seconds import Seconds
from gcs.video.tap import Coding, Library

INDEX: Final = "film.jsonl"
SUFFIXES: Final = {"h264": "h264", "hevc": "h265", "mjpeg": "mjpeg", "mpeg2video": "m2v", "mpeg4": "m4v"}


class StreamRow(msgspec.Struct, frozen=True, tag="stream"):
    """Of the packets that follow, see `Coding`; lossy: what was tracked was encoded for the film, and is not in it."""

    file: str
    codec: str
    library: Library
    extradata: bytes = b""
    reorder_depth: int = 0
    parses: bool = False
    in_slices: bool = False
    lossy: bool = False

    @property
    def coding(self) -> Coding:
        """For a decoder."""
        return Coding(self.codec, self.library, self.extradata, self.reorder_depth, self.parses, self.in_slices)


class PacketRow(msgspec.Struct, frozen=True, tag="packet", omit_defaults=True):
    """size bytes from `at` on. n: numbers are counted on over connections; one that is missing was not recorded.

    key: a decoder can begin here. skips: see `Tap.packet`. size 0: the connection had ended.
    """

    n: int
    at: int
    size: int
    t_arrival_s: Seconds
    key: bool = False
    skips: bool = False


def film_name(codec: str, number: int) -> str:
    """Of the file that holds this codec, the number-th (from 1) of a flight."""
    return f"film{'' if number == 1 else f'-{number}'}.{SUFFIXES[codec]}"


def stream_row(file: str, coding: Coding, *, lossy: bool) -> StreamRow:
    """A connection begins."""
    return StreamRow(
        file, coding.codec, coding.library, coding.extradata, coding.reorder_depth, coding.parses, coding.in_slices,
        lossy,
    )  # fmt: skip
