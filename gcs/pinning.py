"""Which vehicle is ours: the first multicopter heard, or the one asked for; the others are known by name. Pure."""

from __future__ import annotations

from dataclasses import replace

from gcs import codec
from gcs.backend import Backend
from gcs.codec import VehicleId
from gcs.framing import Deframer, Message
from gcs.transport import Peer

_OTHERS = 16
_FORGET_S = 5.0
_LOOK_PERIOD_S = 0.1


class VehiclePin:
    """Pins one system, component and autopilot for the life of a wire."""

    def __init__(self, wanted_system_id: int | None, backend: Backend = Backend.SETPOINTS) -> None:
        self._wanted_system_id = wanted_system_id
        self._backend = backend
        self._others: dict[str, float] = {}  # name -> last heard, s
        self._looked_t_s = float("-inf")
        self.vehicle: VehicleId | None = None
        self.unusable = ""  # why what has been heard is not ours

    def is_ours(self, message: Message, now_s: float) -> bool:
        """This message is the vehicle's own; its first heartbeat pins it."""
        heard = self._identify(message)
        if self.vehicle is None:
            self._pin(message, heard)
        if self.vehicle is None:
            return False
        if heard is not None and heard != self.vehicle:  # also another autopilot under the same id
            self._note(heard, now_s)
        return codec.is_from(message, self.vehicle) and not self.is_impostor(message)

    def is_impostor(self, message: Message) -> bool:
        """A heartbeat under the vehicle's ids from something that is not that autopilot."""
        return (
            self.vehicle is not None
            and codec.is_from(message, self.vehicle)
            and message.get_type() == "HEARTBEAT"
            and self._identify(message) != self.vehicle
        )

    def _identify(self, message: Message) -> VehicleId | None:
        heard = codec.identify(message)
        return None if heard is None else replace(heard, autopilot=heard.autopilot.by(self._backend))

    def _pin(self, message: Message, heard: VehicleId | None) -> None:
        if heard is None:
            self.unusable = codec.unusable_reason(message) or self.unusable
        elif self._wanted_system_id not in (None, heard.system_id):
            self.unusable = f"heard {heard}, wanted system {self._wanted_system_id}"
        else:
            self.vehicle = heard

    def glance(self, datagram: bytes, peer: Peer | None, now_s: float) -> None:
        """Look who sent a datagram that is ignored, seldom enough that a flood costs nothing."""
        if self.vehicle is None or not _may_be_heartbeat(datagram) or now_s - self._looked_t_s < _LOOK_PERIOD_S:
            return
        self._looked_t_s = now_s
        for message in Deframer().datagram(datagram):
            heard = self._identify(message)
            if heard is not None:
                self._note(heard, now_s, f" at {peer[0]}:{peer[1]}" if peer else "")

    def _note(self, heard: VehicleId, now_s: float, where: str = "") -> None:
        name = f"{heard}{where}"
        if len(self._others) >= _OTHERS:
            self._others = {other: t_s for other, t_s in self._others.items() if now_s - t_s <= _FORGET_S}
        if name in self._others or len(self._others) < _OTHERS:
            self._others[name] = now_s

    def others(self, now_s: float) -> tuple[str, ...]:
        """Vehicles heard in the last 5 s that are not ours, and are ignored."""
        return tuple(sorted(name for name, t_s in self._others.items() if now_s - t_s <= _FORGET_S))


def _may_be_heartbeat(datagram: bytes) -> bool:
    return datagram[7:10] == b"\0\0\0" if datagram[:1] == b"\xfd" else datagram[5:6] == b"\0"
