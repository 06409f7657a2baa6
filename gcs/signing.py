"""MAVLink 2 message signing, both ways, on whole frames (mavlink.io/en/guide/message_signing).

At byte level, because MAVSDK makes unsigned bytes and pymavlink's own check cannot be relied on: it remembers the
time of a forged frame, which then locks the real sender out, and lets its exceptions pass with a wrong signature.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
from collections import Counter
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from gcs.clock import Clock
from gcs.framing import MARKER_V2, SIGNED, dialect, message_id
from gcs.keys import SigningKey, read_key
from gcs.signing_time import UNITS_PER_S, SigningTime

# A radio puts its own state on the link and has no key. Nothing else is believed without a signature.
UNSIGNED_ALLOWED: Final = frozenset({dialect.MAVLINK_MSG_ID_RADIO_STATUS})
FIRST_CONTACT: Final = 60 * UNITS_PER_S  # a sender unknown so far may be behind by this much
_HEADER_BYTES: Final = 10
_ALARM_S: Final = 10.0
log = logging.getLogger(__name__)


class Verdict(Enum):
    """What a frame's signature says."""

    SIGNED = "signed"
    ALLOWED = "unsigned, allowed"
    UNSIGNED = "unsigned"
    FORGED = "wrong signature or key"
    REPLAYED = "replayed"
    OLD = "too old"


ACCEPTED: Final = frozenset({Verdict.SIGNED, Verdict.ALLOWED})


@dataclass(frozen=True, slots=True)
class Alarm:
    """Refused frames since `since_s`, by kind."""

    t_s: float
    text: str


class Signing:
    """One link's signing: a key, a link id, and times that only go forward."""

    def __init__(self, key: SigningKey, times: SigningTime, clock: Clock, link_id: int = 0) -> None:
        self._key = key
        self._times = times
        self._clock = clock
        self._link_id = link_id
        self._said = Counter[Verdict]()
        self._said_t_s = float("-inf")
        self._alarm: Alarm | None = None
        self.counts = Counter[Verdict]()

    @classmethod
    def open(cls, path: Path, clock: Clock, link_id: int = 0) -> Signing:
        """With the key of this file and its times beside it (blocks on the disk); GcsError if either is unusable."""
        return cls(read_key(path), SigningTime(path.with_name(path.name + ".time"), clock), clock, link_id)

    @property
    def fingerprint(self) -> str:
        """Of the key."""
        return self._key.fingerprint

    @property
    def refused(self) -> int:
        """Frames dropped since the start."""
        return sum(count for verdict, count in self.counts.items() if verdict not in ACCEPTED)

    def sign(self, frame: bytes) -> bytes:
        """The frame, unsigned MAVLink 2 of a known message, with flag, checksum and signature; ValueError."""
        known = dialect.mavlink_map.get(message_id(frame))
        if frame[0] != MARKER_V2 or frame[2] & SIGNED or known is None:
            raise ValueError("only an unsigned MAVLink 2 frame of a known message can be signed")
        signed = bytearray(frame[:-2])
        signed[2] |= SIGNED
        signed += dialect.x25crc(signed[1:] + bytes([known.crc_extra])).crc.to_bytes(2, "little")
        signed.append(self._link_id)
        signed += self._times.take().to_bytes(6, "little")
        return bytes(signed + _digest(self._key, signed))

    def accepts(self, frame: bytes | bytearray) -> bool:
        """Whether a received frame with a right checksum may be believed; counts, and warns of what may not."""
        verdict = self._judge(frame)
        self.counts[verdict] += 1
        if verdict not in ACCEPTED:
            self._warn()
        return verdict in ACCEPTED

    def _judge(self, frame: bytes | bytearray) -> Verdict:
        if not is_signed(frame):
            return Verdict.ALLOWED if message_id(frame) in UNSIGNED_ALLOWED else Verdict.UNSIGNED
        # Before anything of it is believed or remembered.
        if not is_signed_with(frame, self._key):
            return Verdict.FORGED
        stream = (frame[-13], frame[5], frame[6])
        timestamp = int.from_bytes(frame[-12:-6], "little")
        last = self._times.streams.get(stream)
        if last is not None and timestamp <= last:
            return Verdict.REPLAYED
        if last is None and timestamp < self._times.now() - FIRST_CONTACT:
            return Verdict.OLD
        self._times.heard(stream, timestamp)
        return Verdict.SIGNED

    def _warn(self) -> None:
        """At most one line in 10 s, however many frames are refused."""
        now_s = self._clock.now_s()
        if now_s - self._said_t_s < _ALARM_S:
            return
        new = self.counts - self._said
        kinds = ", ".join(
            f"{new[verdict]} {verdict.value}" for verdict in Verdict if verdict not in ACCEPTED and new[verdict]
        )
        self._alarm = Alarm(now_s, f"refused on the link: {kinds}")
        self._said, self._said_t_s = self.counts.copy(), now_s
        log.warning("%s", self._alarm.text)

    def alarm(self, now_s: float) -> str | None:
        """What was refused lately, for the operator; None if all is well."""
        recent = self._alarm is not None and now_s - self._alarm.t_s < _ALARM_S
        return self._alarm.text if recent and self._alarm is not None else None

    def close(self) -> None:
        """Keep the last time used (blocks on the disk)."""
        self._times.close()


def is_signed_with(frame: bytes | bytearray, key: SigningKey) -> bool:
    """The signature of this whole frame is there and right; says nothing of its age."""
    return is_signed(frame) and hmac.compare_digest(_digest(key, frame[:-6]), bytes(frame[-6:]))


def _digest(key: SigningKey, signed: bytes | bytearray) -> bytes:
    return hashlib.sha256(key.secret + signed).digest()[:6]


def open_signing(key_file: str | None, clock: Clock) -> Signing | None:
    """The signing with the key of this file, if any is named (blocks on the disk); GcsError if it is unusable."""
    return None if key_file is None else Signing.open(Path(key_file).expanduser(), clock)


def is_signed(frame: bytes | bytearray) -> bool:
    """There is a signature; says nothing of whose."""
    return frame[0] == MARKER_V2 and bool(frame[2] & SIGNED)


def security(signing: Signing | None, vehicle_signs: bool) -> str:
    """For people: whether senders are known."""
    if signing is not None:
        return f"signed link, key {signing.fingerprint}"
    hint = ", though the vehicle signs and may not believe us: give --signing-key" if vehicle_signs else ""
    return f"unsigned link{hint}"
