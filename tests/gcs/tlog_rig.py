"""Telemetry logs as other stations write them: a mocked vehicle's frames and a station's own, each with its time."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

from pymavlink.dialects.v10 import ardupilotmega as mavlink1
from pymavlink.dialects.v20 import all as mavlink2

from gcs.framing import split_frames
from sitl_mocks.vehicle import MockVehicle, Personality

UNIX_S = 1_777_800_000.0
RATES_HZ = {  # as if a station had asked for them
    mavlink2.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink2.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink2.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink2.MAVLINK_MSG_ID_ATTITUDE: 20.0,
    mavlink2.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
    mavlink2.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
}
Stamped = tuple[float, bytes]  # seconds since 1970, frame


def vehicle_frames(
    span_s: float = 10.0, *, personality: Personality = Personality.PX4, system_id: int = 1, start_s: float = UNIX_S
) -> list[Stamped]:
    """What a vehicle that hovers 12 m high sends by itself."""
    vehicle = MockVehicle(personality, airborne_m=12.0, system_id=system_id, tick_s=0.01, rates_hz=RATES_HZ)
    frames = []
    for step in range(round(span_s * 100)):
        for datagram in vehicle.step(step * 0.01):
            frames += [(start_s + step * 0.01, frame) for frame in split_frames(datagram) or ()]
    return frames


def station_frames(span_s: float, start_s: float = UNIX_S) -> list[Stamped]:
    """A station's heartbeats, once a second, in MAVLink 1, as Mission Planner may send them."""
    mav = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
    return [
        (start_s + second + 0.5, bytes(mav.heartbeat_encode(6, 8, 0, 0, 4).pack(mav))) for second in range(int(span_s))
    ]


def heartbeat(kind: int, autopilot: int, system_id: int = 1) -> bytes:
    """Of anything; MAV_TYPE and MAV_AUTOPILOT."""
    mav = mavlink2.MAVLink(None, srcSystem=system_id, srcComponent=1)
    return bytes(mav.heartbeat_encode(kind, autopilot, 0, 0, 4).pack(mav))


def write_tlog(path: Path, frames: Iterable[Stamped]) -> Path:
    """In the order of time."""
    ordered = sorted(frames, key=lambda each: each[0])
    return write_records(path, ordered)


def write_records(path: Path, frames: Iterable[Stamped]) -> Path:
    """In this very order."""
    path.write_bytes(b"".join(struct.pack(">Q", int(unix_s * 1e6)) + frame for unix_s, frame in frames))
    return path
