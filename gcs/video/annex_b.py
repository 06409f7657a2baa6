"""H.264 and H.265 as files and RTMP describe them (avcC, hvcC), and as every player takes them (Annex B)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

_START: Final = b"\0\0\0\1"
_CODECS: Final = frozenset({"h264", "hevc"})


def is_annex_b(codec: str, extradata: bytes) -> bool:
    """Whether packets need no filter; other codecs never do. Only a configuration record begins with a 1."""
    return codec not in _CODECS or not extradata.startswith(b"\1")


def parameter_sets(codec: str, record: bytes) -> bytes:
    """Those of an AVCDecoderConfigurationRecord or HEVCDecoderConfigurationRecord (ISO/IEC 14496-15), as Annex B.

    Of a damaged one as many as there are.
    """
    units = _of_avcc(record) if codec == "h264" else _of_hvcc(record)
    return b"".join(_START + unit for unit in units if unit)


def _of_avcc(record: bytes) -> Iterator[bytes]:
    at = 5
    for mask in (0x1F, 0xFF):  # the sequence's parameters, then the pictures'
        count, at = int.from_bytes(record[at : at + 1], "big") & mask, at + 1
        for _ in range(count):
            unit, at = _unit(record, at)
            yield unit


def _of_hvcc(record: bytes) -> Iterator[bytes]:
    at = 23
    for _ in range(int.from_bytes(record[22:23], "big")):
        count, at = int.from_bytes(record[at + 1 : at + 3], "big"), at + 3
        for _ in range(count):
            unit, at = _unit(record, at)
            yield unit


def _unit(record: bytes, at: int) -> tuple[bytes, int]:
    end = at + 2 + int.from_bytes(record[at : at + 2], "big")
    return record[at + 2 : end], end
