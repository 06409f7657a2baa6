"""Telemetry messages out of the vehicle's state, one function per MAVLink message."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.dynamics import Vec3
from sitl_mocks.vehicle import streams as ids
from sitl_mocks.vehicle.autopilot import Autopilot, battery_volts
from sitl_mocks.vehicle.faults import Faults
from sitl_mocks.vehicle.modes import Mode, Personality, numbers

_EARTH_RADIUS_M = 6378137.0
_NAN = math.nan
_CAPABILITIES = {Personality.PX4: 59647, Personality.ARDUPILOT: 64495}
_AUTOPILOT = {Personality.PX4: 12, Personality.ARDUPILOT: 3}
# MAV_SYS_STATUS_SENSOR: gyro, accelerometer, magnetometer, pressure, GPS, RC receiver, battery.
_GYRO, _ACCEL, _MAG, _BARO, _GPS, _RC, _BATTERY = 1, 2, 4, 8, 0x20, 0x10000, 0x2000000
_PREARM = 0x10000000
_SENSORS = _GYRO | _ACCEL | _MAG | _BARO | _GPS | _BATTERY
_CHARGE_STATES = ((0.05, 4), (0.07, 3), (0.15, 2))  # up to what is left: emergency, critical, low
_CHARGE_UNHEALTHY = 6
_STANDARD_MODE = {
    Mode.POSITION: 1,
    Mode.ALTITUDE: 3,
    Mode.RETURN: 5,
    Mode.MISSION: 7,
    Mode.LAND: 8,
    Mode.TAKEOFF: 9,
}


@dataclass(frozen=True, slots=True)
class Home:
    """Geographic origin of the NED frame: degrees, metres above mean sea level."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0

    def offset_ned_m(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vec3:
        """NED metres from here, flat earth as `View` has it."""
        scale = _EARTH_RADIUS_M * math.cos(math.radians(self.latitude_deg))
        north_m = math.radians(latitude_deg - self.latitude_deg) * _EARTH_RADIUS_M
        return north_m, math.radians(longitude_deg - self.longitude_deg) * scale, self.altitude_m - altitude_m


@dataclass(frozen=True, slots=True)
class View:
    """What the messages are made of; boot_s counts from the vehicle's start, unix_s is the wall clock."""

    autopilot: Autopilot
    home: Home
    boot_s: float
    unix_s: float
    faults: Faults

    @property
    def gps_ok(self) -> bool:
        """The receiver has a fix."""
        return not self.faults.gps_lost

    @property
    def battery_percent(self) -> int:
        """What is left, -1 when it is not known."""
        return -1 if self.faults.battery_unknown else round(self.autopilot.battery_frac * 100)

    @property
    def battery_mv(self) -> int:
        """The pack's voltage."""
        return round(1000 * battery_volts(self.autopilot.battery_frac))

    @property
    def boot_ms(self) -> int:
        """time_boot_ms."""
        return round(self.boot_s * 1e3) & 0xFFFFFFFF

    @property
    def boot_us(self) -> int:
        """Time since boot in microseconds."""
        return round(self.boot_s * 1e6)

    def latitude_longitude_e7(self) -> tuple[int, int]:
        """Position in 1e-7 degrees, flat earth around home."""
        north, east, _ = self.autopilot.flight.body.motion.position_ned_m
        latitude = self.home.latitude_deg + math.degrees(north / _EARTH_RADIUS_M)
        scale = _EARTH_RADIUS_M * math.cos(math.radians(self.home.latitude_deg))
        return round(latitude * 1e7), round((self.home.longitude_deg + math.degrees(east / scale)) * 1e7)

    @property
    def altitude_amsl_m(self) -> float:
        """Height above mean sea level in m."""
        return self.home.altitude_m + self.autopilot.flight.height_m


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """ZYX Euler angles (rad) as w, x, y, z."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def _heartbeat(view: View) -> Any:
    pilot = view.autopilot
    number = numbers(pilot.personality)[pilot.mode]
    return mavlink.MAVLink_heartbeat_message(
        2, _AUTOPILOT[pilot.personality], pilot.base_mode(), number, pilot.system_status(), 3
    )


def _current_mode(view: View) -> Any:
    pilot = view.autopilot
    table = numbers(pilot.personality)
    return mavlink.MAVLink_current_mode_message(
        _STANDARD_MODE.get(pilot.mode, 0), table[pilot.mode], table[pilot.intended]
    )


def _sys_status(view: View) -> Any:
    pilot = view.autopilot
    present = _SENSORS | _PREARM | (_RC if pilot.sticks_present else 0)
    health = present & ~(0 if view.gps_ok else _GPS) & ~(0 if pilot.ready else _PREARM | _GPS)
    health &= ~(_BATTERY if view.faults.battery_fault else 0)
    battery = (view.battery_mv, 1200, view.battery_percent)
    return mavlink.MAVLink_sys_status_message(present, present, health, 250, *battery, 0, 0, 0, 0, 0, 0)


def _battery_status(view: View) -> Any:
    left, limits = view.autopilot.battery_frac, _CHARGE_STATES
    charge = next((state for below, state in limits if left <= below), 1)
    cells_mv = [view.battery_mv] + [65535] * 9
    broken = view.faults.battery_fault
    if broken:
        charge = _CHARGE_UNHEALTHY
    return mavlink.MAVLink_battery_status_message(
        0, 0, 1, 32767, cells_mv, 1200, -1, -1, view.battery_percent, 0, charge, fault_bitmask=2 if broken else 0
    )


def _attitude(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    return mavlink.MAVLink_attitude_message(view.boot_ms, m.roll_rad, m.pitch_rad, m.yaw_rad, *m.body_rates_rps)


def _attitude_quaternion(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    q = quaternion(m.roll_rad, m.pitch_rad, m.yaw_rad)
    return mavlink.MAVLink_attitude_quaternion_message(view.boot_ms, *q, *m.body_rates_rps)


def _attitude_target(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    q = quaternion(m.roll_rad, m.pitch_rad, m.yaw_rad)
    thrust = 0.5 if view.autopilot.flight.flying else 0.0
    return mavlink.MAVLink_attitude_target_message(view.boot_ms, 0, q, *m.body_rates_rps, thrust)


def _local_position(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    return mavlink.MAVLink_local_position_ned_message(view.boot_ms, *m.position_ned_m, *m.velocity_ned_mps)


def _global_position(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    velocity_cmps = (round(v * 100) for v in m.velocity_ned_mps)
    heading = round(math.degrees(m.yaw_rad) % 360.0 * 100) % 36000
    altitude_mm, relative_mm = round(view.altitude_amsl_m * 1e3), round(view.autopilot.flight.height_m * 1e3)
    position = view.latitude_longitude_e7()
    return mavlink.MAVLink_global_position_int_message(
        view.boot_ms, *position, altitude_mm, relative_mm, *velocity_cmps, heading
    )


def _odometry(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    unknown = [_NAN] * 21
    q = quaternion(m.roll_rad, m.pitch_rad, m.yaw_rad)
    return mavlink.MAVLink_odometry_message(
        view.boot_us, 1, 1, *m.position_ned_m, q, *m.velocity_ned_mps, *m.body_rates_rps, unknown, unknown, 0, 1
    )


def _position_target(view: View) -> Any:
    """The setpoint in force in NED (frame 1): PX4 puts NaN where nothing is controlled, ArduCopter a mask."""
    pilot = view.autopilot
    flight = pilot.flight
    point = None
    if pilot.mode is Mode.EXTERNAL and flight.setpoint is not None:
        point = flight.setpoint.position_ned_m
    elif flight.hold_ned_m is not None:
        point = flight.hold_ned_m
    px4 = pilot.personality is Personality.PX4
    unset = _NAN if px4 else 0.0
    mask = 0 if px4 else 0x1C0 | (0x7 if point is None else 0) | (0x400 if flight.command.yaw_rad is None else 0)
    yaw = unset if flight.command.yaw_rad is None else flight.command.yaw_rad
    north, east, down = flight.command.velocity_ned_mps
    return mavlink.MAVLink_position_target_local_ned_message(
        view.boot_ms, 1, mask, *(point or (unset,) * 3), north + view.faults.echo_offset_mps, east, down,
        unset, unset, unset, yaw, flight.command.yaw_rate_rps,
    )  # fmt: skip


def _altitude(view: View) -> Any:
    height = view.autopilot.flight.height_m
    amsl = view.altitude_amsl_m
    return mavlink.MAVLink_altitude_message(view.boot_us, amsl, amsl, height, height, _NAN, _NAN)


def _vfr_hud(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    speed = math.hypot(*m.velocity_ned_mps[:2])
    heading = round(math.degrees(m.yaw_rad) % 360.0) % 360
    throttle = 50 if view.autopilot.flight.flying else 0
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, heading, throttle, view.altitude_amsl_m, -m.velocity_ned_mps[2]
    )


def _gps_raw(view: View) -> Any:
    m = view.autopilot.flight.body.motion
    fix, satellites = (3, 14) if view.gps_ok else (1, 3)
    speed_cmps = round(math.hypot(*m.velocity_ned_mps[:2]) * 100)
    course = round(math.degrees(math.atan2(m.velocity_ned_mps[1], m.velocity_ned_mps[0])) % 360.0 * 100) % 36000
    altitude_mm = round(view.altitude_amsl_m * 1e3)
    position = view.latitude_longitude_e7()
    return mavlink.MAVLink_gps_raw_int_message(
        view.boot_us, fix, *position, altitude_mm, 70, 90, speed_cmps, course, satellites
    )


def _estimator_status(view: View) -> Any:
    flags = 0x1FF & ~0x80 if view.autopilot.position_valid else 0x01 | 0x20 | 0x80
    if view.faults.estimator_flags is not None:
        flags = view.faults.estimator_flags
    return mavlink.MAVLink_estimator_status_message(view.boot_us, flags, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5, 0.5)


def _extended_sys_state(view: View) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(0, view.autopilot.flight.landed)


def _home_position(view: View) -> Any:
    home = view.home
    return mavlink.MAVLink_home_position_message(
        round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), round(home.altitude_m * 1e3),
        0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, view.boot_us,
    )  # fmt: skip


def _autopilot_version(view: View) -> Any:
    capabilities = _CAPABILITIES[view.autopilot.personality]
    version = 0x010F00FF if view.autopilot.personality is Personality.PX4 else 0x04070000
    one = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, version, version, 0, 0, one, one, one, 0, 0, 0x4D4F434B, [0] * 18
    )


def _timesync(view: View) -> Any:
    return mavlink.MAVLink_timesync_message(0, round(view.boot_s * 1e9))


def _system_time(view: View) -> Any:
    return mavlink.MAVLink_system_time_message(round(view.unix_s * 1e6), view.boot_ms)


BUILDERS: Mapping[int, Callable[[View], Any]] = {
    ids.HEARTBEAT: _heartbeat,
    ids.SYS_STATUS: _sys_status,
    ids.SYSTEM_TIME: _system_time,
    ids.GPS_RAW_INT: _gps_raw,
    ids.ATTITUDE: _attitude,
    ids.ATTITUDE_QUATERNION: _attitude_quaternion,
    ids.LOCAL_POSITION_NED: _local_position,
    ids.GLOBAL_POSITION_INT: _global_position,
    ids.VFR_HUD: _vfr_hud,
    ids.ATTITUDE_TARGET: _attitude_target,
    ids.POSITION_TARGET_LOCAL_NED: _position_target,
    ids.TIMESYNC: _timesync,
    ids.ALTITUDE: _altitude,
    ids.BATTERY_STATUS: _battery_status,
    ids.AUTOPILOT_VERSION: _autopilot_version,
    ids.ESTIMATOR_STATUS: _estimator_status,
    ids.HOME_POSITION: _home_position,
    ids.EXTENDED_SYS_STATE: _extended_sys_state,
    ids.ODOMETRY: _odometry,
    ids.CURRENT_MODE: _current_mode,
}
