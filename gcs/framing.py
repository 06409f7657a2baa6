"""MAVLink frames out of bytes and back, no I/O: tolerates any garbage, never raises on what comes in."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import all as every_dialect

# `common` lacks CURRENT_MODE (436), and only a message that is known can be verified: so, all of them.
dialect: Any = every_dialect
Message: TypeAlias = Any  # a pymavlink MAVLink_message; the package carries no types

MARKER_V1, MARKER_V2 = 0xFE, 0xFD
SIGNED = 0x01  # the only incompatibility flag there is
_SIGNATURE_BYTES = 13
_MARKER = re.compile(b"[\xfd\xfe]")
MAX_DATAGRAM_BYTES = 4096  # more is not MAVLink; bounds the time that garbage can cost


class CodecError(ValueError):
    """A message that cannot be written as MAVLink: a field out of range or not finite."""


@dataclass(slots=True)
class FrameCounters:
    """What a Deframer has seen."""

    good: int = 0
    bad: int = 0  # runs of bytes without a frame that can be verified, and oversized datagrams


class Encoder:
    """Writes our own frames: MAVLink 2, one sequence number per frame."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mav: Any = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def encode(self, message: Message) -> bytes:
        """One frame; CodecError if a field does not fit its wire type."""
        try:
            frame: bytes = message.pack(self._mav)
        except (struct.error, TypeError, ValueError) as error:
            raise CodecError(f"{message.get_type()} cannot be encoded: {error}") from error
        self._mav.seq = (self._mav.seq + 1) % 256  # only pymavlink's own send() would do it
        return frame


class Deframer:
    """Finds the valid frames in datagrams or in a byte stream.

    After anything that fails its checksum the search goes on at the next byte, so garbage in front of a good
    frame cannot swallow it. A datagram leaves no state behind; a stream keeps at most one unfinished frame.
    """

    def __init__(self) -> None:
        self._mav: Any = dialect.MAVLink(None)
        self._rest = bytearray()
        self._in_garbage = False
        self.counters = FrameCounters()

    def datagram(self, data: bytes) -> list[Message]:
        """The valid messages of one datagram, in order."""
        if len(data) > MAX_DATAGRAM_BYTES:
            self.counters.bad += 1
            return []
        messages, _ = self._scan(bytearray(data), keep_unfinished=False)
        self._in_garbage = False
        return messages

    def stream(self, data: bytes) -> list[Message]:
        """The valid messages that these bytes complete; an unfinished frame waits for the next bytes."""
        buffer = self._rest + data
        messages, used = self._scan(buffer, keep_unfinished=True)
        self._rest = buffer[used:]
        return messages

    def reset(self) -> None:
        """Forget an unfinished frame (after a reconnect)."""
        self._rest = bytearray()
        self._in_garbage = False

    def _scan(self, buffer: bytearray, keep_unfinished: bool) -> tuple[list[Message], int]:
        messages: list[Message] = []
        at = 0
        while at < len(buffer):
            length = frame_length(buffer, at)
            if length is None or at + length > len(buffer):
                if keep_unfinished:
                    break
                length = 0
            message = self._message(buffer[at : at + length])
            if message is not None:
                messages.append(message)
                self.counters.good += 1
                at += length
            else:
                self.counters.bad += not self._in_garbage
                marker = _MARKER.search(buffer, at + 1)
                at = marker.start() if marker is not None else len(buffer)
            self._in_garbage = message is None
        return messages, at

    def _message(self, frame: bytearray) -> Message | None:
        """The message of a frame, if it is a valid one; empty = no frame."""
        if not frame or message_id(frame) not in dialect.mavlink_map:  # its checksum cannot be known
            return None
        try:
            return self._mav.decode(frame)
        except (dialect.MAVError, struct.error, ValueError):
            return None


def frame_length(buffer: Sequence[int], at: int) -> int | None:
    """Bytes of the frame that starts at `at`; 0 = none starts here, None = too short to tell."""
    if buffer[at] == MARKER_V1:
        return None if len(buffer) < at + 2 else 6 + buffer[at + 1] + 2
    if buffer[at] != MARKER_V2:
        return 0
    if len(buffer) < at + 3:
        return None
    flags = buffer[at + 2]
    if flags & ~SIGNED:
        return 0
    return 10 + buffer[at + 1] + 2 + (_SIGNATURE_BYTES if flags & SIGNED else 0)


def message_id(frame: bytes | bytearray) -> int:
    """Of a whole frame."""
    if frame[0] == MARKER_V1:
        return frame[5]
    return frame[7] | frame[8] << 8 | frame[9] << 16


def split_frames(data: bytes) -> list[bytes] | None:
    """The frames that fill `data` exactly; None if anything else is in it.

    For bytes of our own side (MAVSDK), whose checksums need no check but whose kinds do.
    """
    buffer, at, frames = bytearray(data), 0, list[bytes]()
    while at < len(buffer):
        length = frame_length(buffer, at)
        if not length or at + length > len(buffer):
            return None
        frames.append(data[at : at + length])
        at += length
    return frames or None
