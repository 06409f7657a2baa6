"""Whoever keeps the video is told what the decoder is told, and can decode it again, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from gcs.video.frame import Image


class Library(StrEnum):
    """What decodes: the same bytes give other pictures with another."""

    FFMPEG = "ffmpeg"  # through PyAV
    OPENCV = "opencv"  # single JPEG pictures


@dataclass(frozen=True, slots=True)
class Coding:
    """How the packets of one connection are decoded.

    codec: as FFmpeg names it. extradata: what the connection said before its first packet, Annex B for H.264 and H.265.
    reorder_depth: how many pictures FFmpeg expected to wait for one that belongs before them. parses: packets are
    pieces that a parser puts together. in_slices: packets hold slices, not pictures for certain.
    """

    codec: str
    library: Library
    extradata: bytes = b""
    reorder_depth: int = 0
    parses: bool = False
    in_slices: bool = False


class Tap(Protocol):
    """Called on the threads of a source, one at a time; must not wait and must not raise."""

    def opened(self, coding: Coding) -> bool:
        """A connection, or another after it broke; whether its packets are wanted: else its pictures are."""
        ...

    def packet(self, data: bytes, t_arrival_s: float, *, is_key: bool, skips: bool = False) -> int:
        """What goes into the decoder next; returns its number, counted on from connection to connection.

        skips: whether pictures that no other one needs are left out, because the decoder is behind. No data: the
        connection has ended, and the decoder gives what it still holds.
        """
        ...

    def picture(self, image_bgr: Image, t_arrival_s: float) -> int:
        """A picture of which there are no packets; returns its number, counted as packets are."""
        ...
