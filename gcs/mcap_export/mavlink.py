"""What the vehicle said, decoded: a topic for each kind of MAVLink message, and its place for a map."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Final

from gcs.framing import Deframer, Message, dialect
from gcs.mcap_export.schemas import mavlink_schema
from gcs.mcap_export.writer import TopicWriter
from gcs.statustext import StatusText, StatusTextAssembler

_UNKNOWN_HEADING: Final = 65535
_NO_COVARIANCE: Final = [0.0] * 9
VehiclePlaceDeg = tuple[float, float, float]  # latitude, longitude (deg), height above mean sea level (m)


class MavlinkTopics:
    """Give it each frame that was received. place: the vehicle's newest; of the first autopilot that is heard."""

    def __init__(self, writer: TopicWriter, say: Callable[[float, StatusText], None]) -> None:
        """say: called for each text of the vehicle."""
        self._writer = writer
        self._say = say
        self._deframer = Deframer()
        self._texts = StatusTextAssembler()
        self._system: int | None = None
        self.place: VehiclePlaceDeg | None = None

    def add(self, t_s: float, data: bytes) -> None:
        """One frame; what cannot be read is left out."""
        for message in self._deframer.datagram(data):
            kind = type(message)
            fields = dict(_fields(message))
            self._writer.put(f"/mavlink/{kind.msgname}", f"mavlink.{kind.msgname}", _schema(kind), t_s, fields)
            self._look(t_s, message)

    def _look(self, t_s: float, message: Message) -> None:
        name, system = message.get_type(), message.get_srcSystem()
        if name == "HEARTBEAT" and self._system is None and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self._system = system
        if system != self._system:
            return
        if name == "STATUSTEXT":
            for text in self._texts.add(message, t_s):
                self._say(t_s, text)
        elif name == "GLOBAL_POSITION_INT" and (message.lat, message.lon) != (0, 0):
            self.place = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
            more: dict[str, Any] = {
                "velocity": {"x": message.vy / 100, "y": message.vx / 100, "z": -message.vz / 100},
            }
            if message.hdg != _UNKNOWN_HEADING:
                more["heading"] = math.radians(message.hdg / 100)
            put_place(self._writer, "/vehicle/location", t_s, self.place, more)


def put_place(
    writer: TopicWriter, topic: str, t_s: float, place: VehiclePlaceDeg, more: dict[str, Any] | None = None
) -> None:
    """A `foxglove.LocationFix`; its height above mean sea level."""
    latitude_deg, longitude_deg, altitude_m = place
    fix = {
        "timestamp": writer.stamp(t_s), "frame_id": "",
        "latitude": latitude_deg, "longitude": longitude_deg, "altitude": altitude_m,
        "position_covariance": _NO_COVARIANCE, "position_covariance_type": 0,
        **(more or {}),
    }  # fmt: skip
    writer.put_foxglove(topic, "foxglove.LocationFix", t_s, fix)


def _fields(message: Message) -> Iterator[tuple[str, Any]]:
    yield "system_id", message.get_srcSystem()
    yield "component_id", message.get_srcComponent()
    yield "sequence", message.get_seq()
    for name in message.fieldnames:
        value = getattr(message, name)
        yield name, value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _schema(kind: Any) -> Callable[[], dict[str, Any]]:
    return lambda: mavlink_schema(kind)
