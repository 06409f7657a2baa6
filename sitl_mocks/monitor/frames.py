"""The frames in a datagram, signed ones too; only the kinds that are judged are decoded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

SETPOINT, COMMAND_INT, COMMAND_LONG, MODE, PARAM_SET, FOLLOW_TARGET = 84, 75, 76, 11, 23, 144
OTHER_SETPOINTS = frozenset({82, 86})  # attitude and global position: never sent by a follow
STICKS = frozenset({69, 70})  # MANUAL_CONTROL, RC_CHANNELS_OVERRIDE
GIMBAL_ATTITUDE, GIMBAL_PITCHYAW, GIMBAL_COMMAND = 282, 287, 1000  # the last a MAV_CMD
_GIMBAL = frozenset({GIMBAL_ATTITUDE, GIMBAL_PITCHYAW})
_JUDGED = (
    frozenset({SETPOINT, COMMAND_INT, COMMAND_LONG, MODE, PARAM_SET, FOLLOW_TARGET})
    | OTHER_SETPOINTS
    | STICKS
    | _GIMBAL
)
_V1, _V2, _SIGNED = 0xFE, 0xFD, 0x01
_CHECKSUM_BYTES, _SIGNATURE_BYTES = 2, 13


def make_decoder() -> Any:
    """Without a key it takes signed frames without looking at the signature; it keeps nothing from frame to frame."""
    return mavlink.MAVLink(None)


def judged_messages(datagram: bytes, decoder: Any) -> Iterator[Any | None]:
    """The decoded messages that matter, in order; None at the end if anything was no whole, sound frame."""
    start, broken = 0, False
    while start < len(datagram):
        end = _frame_end(datagram, start)
        if end is None:
            start, broken = start + 1, True
            continue
        frame, start = datagram[start:end], end
        if _message_id(frame) in _JUDGED:
            try:
                yield decoder.decode(bytearray(frame))
            except mavlink.MAVError:
                broken = True
    if broken:
        yield None


def _frame_end(datagram: bytes, start: int) -> int | None:
    header = {_V1: 6, _V2: 10}.get(datagram[start])
    if header is None or start + header > len(datagram):
        return None
    signed = datagram[start] == _V2 and datagram[start + 2] & _SIGNED
    end = start + header + datagram[start + 1] + _CHECKSUM_BYTES + (_SIGNATURE_BYTES if signed else 0)
    return end if end <= len(datagram) else None


def _message_id(frame: bytes) -> int:
    return frame[5] if frame[0] == _V1 else int.from_bytes(frame[7:10], "little")
