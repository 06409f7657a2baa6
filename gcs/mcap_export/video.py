"""The film of a flight as Foxglove plays it: a message for each whole picture.

H.264 and H.265 go as they are, from a key frame on; what Foxglove does not play goes as JPEG. A picture is stamped with
the arrival of the packet that completed it, and its boxes with the same time: that is how Foxglove puts them together.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections import deque
from typing import Any, Final

import cv2

from gcs.mcap_export.frames import CAMERA
from gcs.mcap_export.writer import TopicWriter
from gcs.recorder.film_reader import FilmPacket, FilmReader
from gcs.replay.log import FrameRow
from gcs.video.tap import Coding

_REMEMBERED: Final = 1000  # packets: a picture is tracked long before so many have come
_FORMATS: Final = {"h264": "h264", "hevc": "h265"}
_UNIT: Final = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)
_PARAMETERS: Final = {"h264": 7, "hevc": 33}  # the sequence's
_KEYS: Final = {"h264": (5,), "hevc": range(16, 24)}  # IDR; IRAP
_JPEG_QUALITY: Final = 85


class FilmTopics:
    """Give it the packets of a film in order. note: what became of it, where it is not as it came."""

    def __init__(self, writer: TopicWriter, film: FilmReader) -> None:
        self._writer = writer
        self._film = film
        self._arrivals: dict[int, float] = {}
        self._numbers: deque[int] = deque()
        self._stream: _Stream | None = None
        self.note: str | None = None

    def add(self, packet: FilmPacket) -> None:
        """The next one."""
        t_s = packet.t_arrival_s
        self._remember(packet.number, t_s)
        if packet.coding.codec == "mjpeg":
            self._put("/camera/image", "foxglove.CompressedImage", t_s, "jpeg", packet.data)
            return
        if self._stream is None or packet.coding != self._stream.coding:
            self._stream = _Stream(packet.coding)
        pictures = self._stream.pictures(packet.data)
        if self._stream.obstacle:
            self._put_jpeg(packet, self._stream.obstacle)
        for picture in pictures:
            self._put("/camera/video", "foxglove.CompressedVideo", t_s, _FORMATS[packet.coding.codec], picture)

    def shown_s(self, row: FrameRow) -> float:
        """The time that this frame's picture is stamped with."""
        return self._arrivals.get(-1 if row.packet is None else row.packet, row.t_arrival_s)

    def _remember(self, number: int, t_arrival_s: float) -> None:
        self._arrivals[number] = t_arrival_s
        self._numbers.append(number)
        if len(self._numbers) > _REMEMBERED:
            self._arrivals.pop(self._numbers.popleft(), None)

    def _put_jpeg(self, packet: FilmPacket, obstacle: str) -> None:
        self.note = f"Foxglove does not play {obstacle}: the film's pictures are JPEG"
        image_bgr = self._film.picture(packet.number)
        if image_bgr is not None:
            _, jpeg = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
            self._put("/camera/image", "foxglove.CompressedImage", packet.t_arrival_s, "jpeg", jpeg.tobytes())

    def _put(self, topic: str, kind: str, t_s: float, of: str, data: bytes) -> None:
        message: dict[str, Any] = {
            "timestamp": self._writer.stamp(t_s), "frame_id": CAMERA, "data": b64encode(data).decode(), "format": of,
        }  # fmt: skip
        self._writer.put_foxglove(topic, kind, t_s, message)


class _Stream:
    """One connection's packets. obstacle: why its pictures cannot go as they are, empty where they can."""

    def __init__(self, coding: Coding) -> None:
        self.coding = coding
        self.obstacle = ""
        self._has_begun = False
        self._parser: Any = None
        if coding.codec not in _FORMATS:
            self.obstacle = coding.codec
        elif coding.reorder_depth:
            self.obstacle = f"{coding.codec} with B-frames"
        elif coding.parses:
            import av  # what was filmed like this was filmed with it

            self._parser = av.CodecContext.create(coding.codec, "r")

    def pictures(self, data: bytes) -> list[bytes]:
        """Those that this packet completes; none before the first key frame, and all with their parameters."""
        if self.obstacle:
            return []
        whole = [data] if self._parser is None else [bytes(each) for each in self._parser.parse(data)]
        return [picture for each in whole if each and (picture := self._playable(each))]

    def _playable(self, picture: bytes) -> bytes:
        codec, extradata = self.coding.codec, self.coding.extradata
        kinds = unit_kinds(codec, picture)
        has_parameters, is_key = _PARAMETERS[codec] in kinds, not kinds.isdisjoint(_KEYS[codec])
        if not self._has_begun and has_parameters and not is_key:
            self.obstacle = f"{codec} without key frames"
        self._has_begun |= is_key and (has_parameters or bool(extradata))
        if not self._has_begun:
            return b""
        return extradata + picture if is_key and not has_parameters else picture


def unit_kinds(codec: str, picture: bytes) -> set[int]:
    """nal_unit_type of all units in Annex B bytes."""
    heads = (found[1][0] for found in _UNIT.finditer(picture))
    return {head & 0x1F if codec == "h264" else head >> 1 & 0x3F for head in heads}
