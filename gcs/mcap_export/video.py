"""The film of a flight as Foxglove plays it: a message for each whole picture, H.264 and H.265 from a key frame on.

A picture is stamped with the arrival of the packet that completed it, and its boxes with the same time: that is how
Foxglove puts them together.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections import deque
from typing import Any, Final

from gcs.mcap_export.frames import CAMERA
from gcs.mcap_export.writer import TopicWriter
from gcs.recorder.film_reader import FilmPacket
from gcs.replay.log import FrameRow
from gcs.video.tap import Coding

_REMEMBERED: Final = 1000  # packets: a picture is tracked long before so many have come
_FORMATS: Final = {"h264": "h264", "hevc": "h265"}
_UNIT: Final = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)
_H264_SPS, _H264_KEY = 7, 5
_H265_SPS, _H265_KEYS = 33, range(16, 24)  # IRAP


class FilmTopics:
    """Give it the packets of a film in order. problem: why pictures are missing, None where none are."""

    def __init__(self, writer: TopicWriter) -> None:
        self._writer = writer
        self._arrivals: dict[int, float] = {}
        self._numbers: deque[int] = deque()
        self._pictures: _Pictures | None = None
        self.problem: str | None = None

    def add(self, packet: FilmPacket) -> None:
        """The next one."""
        codec, t_s = packet.coding.codec, packet.t_arrival_s
        self._remember(packet.number, t_s)
        if codec == "mjpeg":
            self._put("/camera/image", "foxglove.CompressedImage", t_s, "jpeg", packet.data)
            return
        if codec not in _FORMATS:
            self.problem = f"Foxglove plays no {codec}: its pictures are left out"
            return
        if self._pictures is None or packet.coding != self._pictures.coding:
            self._pictures = _Pictures(packet.coding)
        for picture in self._pictures.of(packet.data):
            self._put("/camera/video", "foxglove.CompressedVideo", t_s, _FORMATS[codec], picture)

    def shown_s(self, row: FrameRow) -> float:
        """The time that this frame's picture is stamped with."""
        return self._arrivals.get(-1 if row.packet is None else row.packet, row.t_arrival_s)

    def _remember(self, number: int, t_arrival_s: float) -> None:
        self._arrivals[number] = t_arrival_s
        self._numbers.append(number)
        if len(self._numbers) > _REMEMBERED:
            self._arrivals.pop(self._numbers.popleft(), None)

    def _put(self, topic: str, kind: str, t_s: float, of: str, data: bytes) -> None:
        message: dict[str, Any] = {
            "timestamp": self._writer.stamp(t_s), "frame_id": CAMERA, "data": b64encode(data).decode(), "format": of,
        }  # fmt: skip
        self._writer.put_foxglove(topic, kind, t_s, message)


class _Pictures:
    """Whole pictures out of one connection's packets, none before the first key frame; a key frame brings its SPS."""

    def __init__(self, coding: Coding) -> None:
        self.coding = coding
        self._began = False
        self._parser: Any = None
        if coding.parses:
            import av  # what was filmed like this was filmed with it

            self._parser = av.CodecContext.create(coding.codec, "r")

    def of(self, data: bytes) -> list[bytes]:
        """Those that this packet completes."""
        whole = [data] if self._parser is None else [bytes(each) for each in self._parser.parse(data)]
        return [picture for each in whole if each and (picture := self._playable(each))]

    def _playable(self, picture: bytes) -> bytes:
        kinds = unit_kinds(self.coding.codec, picture)
        has_parameters = (_H264_SPS if self.coding.codec == "h264" else _H265_SPS) in kinds
        is_key = _H264_KEY in kinds if self.coding.codec == "h264" else any(kind in _H265_KEYS for kind in kinds)
        self._began |= is_key and (has_parameters or bool(self.coding.extradata))
        if not self._began:
            return b""
        return self.coding.extradata + picture if is_key and not has_parameters else picture


def unit_kinds(codec: str, picture: bytes) -> set[int]:
    """nal_unit_type of all units in Annex B bytes."""
    heads = (found[1][0] for found in _UNIT.finditer(picture))
    return {head & 0x1F if codec == "h264" else head >> 1 & 0x3F for head in heads}
