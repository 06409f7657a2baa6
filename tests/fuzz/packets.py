"""Damaged MAVLink: what radio noise, a broken autopilot or somebody hostile may put on the link.

Frames are built byte by byte, so that a wrong length or an impossible value can carry a right checksum.
"""

from __future__ import annotations

import functools
import math
import random
import re
import struct
from collections import deque
from enum import Enum
from typing import Any, Final

from pymavlink.dialects.v20 import all as dialect

V1, V2 = 0xFE, 0xFD
HEARTBEAT, CURRENT_MODE = 0, 436
_KEPT: Final = 256
_HEARD: Final = tuple(
    number
    for number, kind in dialect.mavlink_map.items()
    if kind.msgname
    in {
        "ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "EXTENDED_SYS_STATE", "SYS_STATUS", "BATTERY_STATUS",
        "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "HOME_POSITION", "POSITION_TARGET_LOCAL_NED", "RADIO_STATUS",
    }
)  # fmt: skip
_UNHEARD: Final = tuple(number for number in dialect.mavlink_map if number not in {HEARTBEAT, CURRENT_MODE, *_HEARD})
_LIES_FRAC: Final = 0.01
_FLOATS: Final = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 1e9, -1e9)


class Kind(Enum):
    """How a packet is damaged; the first ones never carry a right checksum of the vehicle's own."""

    BIT_FLIPS = "bit flips"
    TRUNCATED = "truncated"
    GARBAGE = "garbage"
    BETWEEN = "frames between garbage"
    EXTREMES = "extreme values, right checksum"
    LENGTH = "wrong length, right checksum"
    SENDER = "other sender, right checksum"
    UNKNOWN = "unknown message"
    VERSION_1 = "MAVLink 1"
    SIGNED = "signature junk"
    SPLICED = "spliced frames"
    MODE_LIE = "impossible mode, right checksum"


_WEIGHTS: Final = dict.fromkeys(Kind, 200) | {Kind.MODE_LIE: 1}


def checksum(number: int, body: bytes) -> bytes:
    """The two bytes after a frame's body (everything between marker and checksum); of a known message."""
    extra = dialect.mavlink_map[number].crc_extra
    return struct.pack("<H", dialect.x25crc(body + bytes([extra])).crc)


def frame(number: int, payload: bytes, system: int, component: int, sequence: int = 0, version: int = V2) -> bytes:
    """A whole frame with a right checksum, whatever the payload's length says."""
    if version == V1:
        body = bytes([len(payload), sequence, system, component, number]) + payload
    else:
        body = bytes([len(payload), 0, 0, sequence, system, component]) + number.to_bytes(3, "little") + payload
    return bytes([version]) + body + checksum(number, body)


class Mutator:
    """Endless damaged packets of one seed; `learn` from what the vehicle really says."""

    def __init__(self, seed: int, system: int = 1, component: int = 1) -> None:
        self._random = random.Random(seed)
        self._system, self._component = system, component
        self._genuine: deque[bytes] = deque(maxlen=_KEPT)
        self.made = dict.fromkeys(Kind, 0)
        self.learn(frame(30, bytes(28), system, component))

    def learn(self, datagram: bytes) -> None:
        """Keep a genuine frame to damage. The mode is left out: to repeat an old one would be a lie well told."""
        alone = len(datagram) > 12 and datagram[0] == V2 and len(datagram) == datagram[1] + 12
        if alone and int.from_bytes(datagram[7:10], "little") not in (HEARTBEAT, CURRENT_MODE):
            self._genuine.append(datagram)

    def packet(self) -> bytes:
        """The next one, a datagram or part of a stream."""
        kind = self._random.choices(list(_WEIGHTS), list(_WEIGHTS.values()))[0]
        self.made[kind] += 1
        return self._make(kind)

    def _make(self, kind: Kind) -> bytes:
        rng, genuine = self._random, self._random.choice(self._genuine)
        match kind:
            case Kind.BIT_FLIPS:
                data = bytearray(genuine)
                for _ in range(rng.choice((1, 1, 2, 8, 40))):
                    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
                return bytes(data)
            case Kind.TRUNCATED:
                return genuine[: rng.randrange(len(genuine))]
            case Kind.GARBAGE:
                return self._garbage(rng.choice((1, 8, 60, 300, 300, 5000)))
            case Kind.BETWEEN:
                return self._garbage(rng.randrange(40)) + genuine + self._garbage(rng.randrange(40)) + genuine
            case Kind.EXTREMES:
                return self._extremes(self._own(), self._system, self._component)
            case Kind.LENGTH:
                payload = rng.randbytes(rng.choice((0, 1, 2, rng.randrange(256), 255)))
                return frame(self._own(), payload, self._system, self._component, rng.randrange(256))
            case Kind.SENDER:
                number = rng.choice((HEARTBEAT, CURRENT_MODE, *_HEARD))
                system = rng.choice((0, 2, 51, 245, 255))
                return self._extremes(number, system, rng.choice((0, 1, 190, 191, 255)))
            case Kind.UNKNOWN:
                number = rng.randrange(60_000, 1 << 24)
                body = bytes([20, 0, 0, 0, self._system, self._component]) + number.to_bytes(3, "little")
                return bytes([V2]) + body + rng.randbytes(22)
            case Kind.VERSION_1:
                number = self._own() & 0xFF
                number = number if number in dialect.mavlink_map and number != HEARTBEAT else _UNHEARD[0]
                size = rng.choice((dialect.mavlink_map[number].unpacker.size, rng.randrange(256)))
                return frame(number, rng.randbytes(size), self._system, self._component, 0, V1)
            case Kind.SIGNED:
                data = bytearray(genuine)
                data[2] = rng.choice((1, 1, 2, 0x80, 0xFF))
                data[-2:] = checksum(int.from_bytes(data[7:10], "little"), bytes(data[1:-2]))
                return bytes(data) + rng.randbytes(rng.choice((13, 13, 5, 0)))
            case Kind.SPLICED:
                other = rng.choice(self._genuine)
                cut = rng.randrange(len(genuine))
                return genuine[:cut] + other * rng.choice((1, 1, 20)) + genuine[cut:]
            case Kind.MODE_LIE:
                return self._extremes(rng.choice((HEARTBEAT, CURRENT_MODE)), self._system, self._component)

    def _own(self) -> int:
        """A message for the vehicle to say; seldom one we listen to, so that a follow can last."""
        return self._random.choice(_HEARD if self._random.random() < _LIES_FRAC else _UNHEARD)

    def _garbage(self, size: int) -> bytes:
        """Random bytes, rich in what looks like the start of a frame."""
        data = bytearray(self._random.randbytes(size))
        for _ in range(size // 20):
            data[self._random.randrange(size)] = self._random.choice((V1, V2))
        return bytes(data)

    def _extremes(self, number: int, system: int, component: int) -> bytes:
        packer: struct.Struct = dialect.mavlink_map[number].unpacker
        payload = packer.pack(*(self._value(letter) for letter in _letters(packer.format)))
        if number in (HEARTBEAT, CURRENT_MODE) and struct.unpack_from("<I", payload)[0] in (4, 6 << 16):
            payload = b"\xff\xff\xff\xff" + payload[4:]  # external control, claimed well, is for signing to find out
        if self._random.random() < 0.5:
            payload = payload.rstrip(b"\0") or b"\0"
        return frame(number, payload, system, component, self._random.randrange(256))

    def _value(self, letter: str) -> Any:
        rng = self._random
        if letter[-1] == "s":
            return rng.choice((b"", b"\xff" * int(letter[:-1]), rng.randbytes(int(letter[:-1])), b"\x1b[2J\n%s{}"))
        if letter == "c":
            return rng.randbytes(1)
        if letter in "fd":
            return rng.choice((*_FLOATS, rng.uniform(-1e3, 1e3)))
        bits = 8 * struct.calcsize(f"<{letter}")
        low, high = (0, (1 << bits) - 1) if letter.isupper() else (-(1 << bits - 1), (1 << bits - 1) - 1)
        return rng.choice((0, low, high, rng.randint(low, high), min(high, 127)))


@functools.cache
def _letters(form: str) -> tuple[str, ...]:
    """A struct format as one letter per value, strings with their length."""
    letters = list[str]()
    for count, letter in re.findall(r"(\d*)([a-zA-Z])", form):
        letters += [f"{count}s"] if letter == "s" else [letter] * int(count or 1)
    return tuple(letters)
