"""MAVLink 2 signing on the vehicle's side: pymavlink's own, and a count of what was turned away and why.

Unsigned messages that are taken all the same are those of PX4's and ArduPilot's sources.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle.modes import Personality

KEY_BYTES = 32
_EPOCH_UNIX_S = 1_420_070_400.0  # 1 January 2015, in units of 10 us from there
_UNITS_PER_S = 1e5
_RADIO_STATUS, _RADIO, _ADSB_VEHICLE, _COLLISION = 109, 166, 246, 247
_TAKEN_UNSIGNED = {
    Personality.PX4: frozenset({_RADIO_STATUS, _ADSB_VEHICLE, _COLLISION}),
    Personality.ARDUPILOT: frozenset({_RADIO_STATUS, _RADIO}),
}


def timestamp_of(unix_s: float) -> int:
    """A wall-clock time (Unix s) as a signature's time stamp."""
    return max(round((unix_s - _EPOCH_UNIX_S) * _UNITS_PER_S), 0)


@dataclass(slots=True)
class SigningCounts:
    """Frames by what became of them."""

    accepted: int = 0
    forged: int = 0  # signed with another key, or changed on the way
    replayed: int = 0  # signed, but not newer than what came before
    unsigned: int = 0  # dropped
    exempt: int = 0  # unsigned and taken

    @property
    def dropped(self) -> int:
        """All that was turned away."""
        return self.forged + self.replayed + self.unsigned


@dataclass(slots=True)
class Signing:
    """One key for all links of a vehicle. Raises ValueError for a key that is not 32 bytes."""

    key: bytes | None
    personality: Personality
    counts: SigningCounts = field(default_factory=SigningCounts)
    _state: Any = field(init=False, default_factory=mavlink.MAVLinkSigning)

    def __post_init__(self) -> None:
        if self.key is not None and len(self.key) != KEY_BYTES:
            raise ValueError(f"signing_key must have {KEY_BYTES} bytes, got {len(self.key)}")
        self._state.allow_unsigned_callback = self._takes_unsigned
        self._use()

    def set_up(self, key: bytes, timestamp: int) -> None:
        """SETUP_SIGNING: take this key from now on; all zeros with a zero time stamp switch signing off."""
        self.key = key if any(key) or timestamp else None
        self._state.timestamp = max(self._state.timestamp, timestamp)
        self._use()

    def _use(self) -> None:
        self._state.secret_key = self.key
        self._state.sign_outgoing = self.key is not None

    def codec(self, system_id: int, component_id: int) -> Any:
        """A pymavlink codec that signs and checks with this key."""
        codec = _Codec(system_id, component_id, self.counts)
        codec.signing = self._state
        return codec

    def at(self, unix_s: float) -> None:
        """Bring the outgoing time stamp forward to the wall clock; it never goes back."""
        if self.key is not None:
            self._state.timestamp = max(self._state.timestamp, timestamp_of(unix_s))

    def unsigned(self, message: Any, codec: Any) -> bytes:
        """Pack without a signature in spite of the key."""
        signs, self._state.sign_outgoing = self._state.sign_outgoing, False
        packed = bytes(message.pack(codec))
        self._state.sign_outgoing = signs
        return packed

    def _takes_unsigned(self, codec: Any, number: int) -> bool:
        del codec
        return number in _TAKEN_UNSIGNED[self.personality]


class _Codec(mavlink.MAVLink):  # type: ignore[misc]
    """pymavlink's, except that a bad signature cannot move the time stamp that genuine ones are checked against."""

    def __init__(self, system_id: int, component_id: int, counts: SigningCounts) -> None:
        super().__init__(None, system_id, component_id)
        self.robust_parsing = True
        self._counts = counts

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:  # noqa: N803 (theirs)
        stream = (msgbuf[-13], srcSystem, srcComponent)
        stamps = self.signing.stream_timestamps
        before = stamps.get(stream)
        if super().check_signature(msgbuf, srcSystem, srcComponent):
            self._counts.accepted += 1
            return True
        late = stamps.get(stream) == before  # turned away before the signature was looked at
        if not late:
            self._counts.forged += 1
            if before is None:
                del stamps[stream]
            else:
                stamps[stream] = before
        else:
            self._counts.replayed += 1
        return False

    def decode(self, msgbuf: bytearray) -> Any:
        exempt, rejected, bad = self.signing.unsigned_count, self.signing.reject_count, self.signing.badsig_count
        try:
            return super().decode(msgbuf)
        finally:
            if self.signing.badsig_count == bad:
                self._counts.exempt += self.signing.unsigned_count - exempt
                self._counts.unsigned += self.signing.reject_count - rejected
