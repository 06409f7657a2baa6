"""A vehicle that signs with pymavlink's own code, which is independent of ours; and frames to attack with."""

from __future__ import annotations

import hashlib
import random
import struct
from typing import Any

from pymavlink.dialects.v20 import all as every
from pymavlink.dialects.v20 import development as mav

SECRET = bytes(range(32))
OTHER = bytes(reversed(range(32)))


def signer(secret: bytes = SECRET, timestamp: int = 0, system_id: int = 1, component_id: int = 1, link: int = 0) -> Any:
    """A packer that signs what it packs."""
    packer = mav.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
    packer.signing.secret_key = secret
    packer.signing.sign_outgoing = True
    packer.signing.timestamp = timestamp
    packer.signing.link_id = link
    return packer


def verifier(secret: bytes = SECRET) -> Any:
    """A parser that takes nothing but what is signed with this key; counts in its `signing`."""
    parser = every.MAVLink(None)
    parser.robust_parsing = True
    parser.signing.secret_key = secret
    return parser


def attack(rng: random.Random, seen: list[bytes], timestamp: int) -> tuple[str, bytes]:
    """One frame that must not be believed: (kind, frame). `seen`: frames already accepted, to replay."""
    kind = rng.choice(("unsigned", "version 1", "wrong key", "forged", "replayed", "flipped", "old", "resigned flag"))
    message = mav.MAVLink_heartbeat_message(2, 12, 0x91, 6 << 16, 4, 3)
    match kind:
        case "unsigned":
            return kind, message.pack(mav.MAVLink(None, 1, 1))
        case "version 1":
            return kind, message.pack(mav.MAVLink(None, 1, 1), force_mavlink1=True)
        case "wrong key":
            return kind, message.pack(signer(rng.choice((OTHER, bytes(32), rng.randbytes(32))), timestamp))
        case "forged":
            return kind, message.pack(signer(SECRET, timestamp))[:-6] + rng.randbytes(6)
        case "replayed":
            return kind, rng.choice(seen)
        case "old":  # the right key, from a sender not heard before, recorded long ago
            return kind, message.pack(signer(SECRET, timestamp - 7_000_000, component_id=rng.randrange(2, 255)))
        case "resigned flag":  # its flag taken away and its checksum put right
            frame = bytearray(message.pack(signer(SECRET, timestamp))[:-15])
            frame[2] = 0
            return kind, bytes(frame) + struct.pack("<H", every.x25crc(frame[1:] + b"\x32").crc)
        case _:
            return "flipped", _flipped(rng, message.pack(signer(SECRET, timestamp)))


def _flipped(rng: random.Random, frame: bytes) -> bytes:
    """One bit wrong; with the checksum put right every second time."""
    out = bytearray(frame)
    at = rng.randrange(len(out))
    out[at] ^= 1 << rng.randrange(8)
    if rng.random() < 0.5 and 4 <= at < len(out) - 15:
        known = every.mavlink_map.get(int.from_bytes(out[7:10], "little"))
        extra = bytes([known.crc_extra]) if known else b""
        out[-15:-13] = struct.pack("<H", every.x25crc(out[1:-15] + extra).crc)
    return bytes(out)


def digest(secret: bytes, frame: bytes) -> bytes:
    """What the standard says the last six bytes of this frame must be."""
    return hashlib.sha256(secret + frame[:-6]).digest()[:6]
