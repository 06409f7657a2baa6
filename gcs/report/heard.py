"""What the vehicle itself said, by its recorded MAVLink frames: its texts, and its state where no decision tells it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gcs.framing import Deframer, Message, dialect, message_id
from gcs.statustext import StatusText, StatusTextAssembler

_AUTOPILOT_COMPONENT: Final = 1
_ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_AUTOPILOTS: Final = {3: "ArduPilot", 12: "PX4"}  # MAV_AUTOPILOT
_EARTH_RADIUS_M: Final = 6_371_000.0
_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_TEXT: Final = dialect.MAVLINK_MSG_ID_STATUSTEXT
_STATE: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        _HEARTBEAT,
    }
)


@dataclass(slots=True)
class Vehicle:
    """As last heard; None: never. mode: as its makers call it. place_m: north and east of home, or of the first fix."""

    autopilot: str | None = None
    mode: str | None = None
    armed: bool = False
    place_m: tuple[float, float] | None = None
    height_m: float | None = None
    battery_frac: float | None = None


@dataclass(slots=True)
class Heard:
    """`add` each frame that was received. texts: what was said since they were last taken."""

    vehicle: Vehicle = field(default_factory=Vehicle)
    _texts: StatusTextAssembler = field(default_factory=StatusTextAssembler)
    _frames: Deframer = field(default_factory=Deframer)
    _system: int | None = None
    _origin_deg: tuple[float, float] | None = None
    _has_local: bool = False

    def add(self, data: bytes, t_s: float, *, state: bool) -> list[StatusText]:
        """The vehicle's texts that this frame completes. state: whether its state is wanted too."""
        if len(data) < 10:  # shorter than any frame
            return []
        kind = message_id(data)
        if kind != _TEXT and not (state and kind in _STATE):
            return []
        said: list[StatusText] = []
        for message in self._frames.datagram(data):
            if message.get_msgId() == _TEXT:
                said += self._texts.add(message, t_s)
            elif message.get_srcComponent() == _AUTOPILOT_COMPONENT:
                self._state(message)
        return said

    def _state(self, message: Message) -> None:
        if message.get_msgId() == _HEARTBEAT and self._system is None and message.autopilot in _AUTOPILOTS:
            self._system = message.get_srcSystem()
            self.vehicle.autopilot = _AUTOPILOTS[message.autopilot]
        if message.get_srcSystem() == self._system:
            _READ[message.get_type()](self, message)

    def _heartbeat(self, message: Message) -> None:
        from pymavlink import mavutil  # slow to import, and most flights do without

        self.vehicle.mode = str(mavutil.mode_string_v10(message))
        self.vehicle.armed = bool(message.base_mode & _ARMED)

    def _sys_status(self, message: Message) -> None:
        if 0 <= message.battery_remaining <= 100:
            self.vehicle.battery_frac = message.battery_remaining / 100

    def _local(self, message: Message) -> None:
        if math.isfinite(message.x) and math.isfinite(message.y):
            self._has_local, self.vehicle.place_m = True, (message.x, message.y)

    def _global(self, message: Message) -> None:
        self.vehicle.height_m = message.relative_alt / 1000
        if self._has_local or (message.lat == 0 and message.lon == 0):  # no fix yet
            return
        lat_deg, lon_deg = message.lat / 1e7, message.lon / 1e7
        self._origin_deg = self._origin_deg or (lat_deg, lon_deg)
        north_rad, east_rad = (math.radians(d - o) for d, o in zip((lat_deg, lon_deg), self._origin_deg, strict=True))
        shrink = math.cos(math.radians(self._origin_deg[0]))
        self.vehicle.place_m = (north_rad * _EARTH_RADIUS_M, east_rad * _EARTH_RADIUS_M * shrink)


_READ: Final[dict[str, Callable[[Heard, Message], None]]] = {
    "HEARTBEAT": Heard._heartbeat,
    "SYS_STATUS": Heard._sys_status,
    "LOCAL_POSITION_NED": Heard._local,
    "GLOBAL_POSITION_INT": Heard._global,
}
