"""A gimbal of MAVLink's Gimbal v2 protocol: the manager is the autopilot (component 1), the device component 154.

Roll is level and pitch counts from the horizon. A rate stays in force until another command replaces it. Angles
in rad: yaw clockwise from north, or from the vehicle's nose where the name says relative; pitch up is positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.dynamics import Motion, Vec3
from sitl_mocks.vehicle.link import Outbox
from sitl_mocks.vehicle.modes import Result
from sitl_mocks.vehicle.telemetry import quaternion

DEVICE_ID: Final = 154
_INFORMATION, _STATUS, _SET_ATTITUDE, _DEVICE_INFORMATION, _ATTITUDE, _SET_PITCHYAW = 280, 281, 282, 283, 285, 287
_PITCHYAW, _CONFIGURE, _SET_INTERVAL, _REQUEST = 1000, 1001, 511, 512
_LOCKS, _YAW_LOCK, _IN_VEHICLE, _IN_EARTH = 4 | 8, 16, 32, 64  # roll and pitch; GIMBAL_DEVICE_FLAGS
_CAPABILITIES: Final = 2 | 32 | 128  # neutral, pitch axis and lock
_YAW_CAPABILITIES: Final = 256 | 512 | 4096  # axis, follow, earth frame
_YAW_LOCK_CAPABILITY: Final = 1024
_NOBODY: Final = (0, 0)
_ANGLE_GAIN_PS: Final = 5.0
_LEAVE, _REMOVE = -1.0, -3.0
_STATUS_HZ: Final = 5.0


def _wrap(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)


class MockGimbal:
    """Give it to `MockVehicle(gimbal=...)`.

    pitch_rad: at the start. has_yaw: False for one that only tilts. earth_frame: how it reports its yaw.
    silent: a test may stop its attitude, or all it answers.
    """

    def __init__(
        self,
        *,
        pitch_rad: float = 0.0,
        has_yaw: bool = True,
        yaw_lock: bool = True,
        earth_frame: bool = True,
        pitch_limits_rad: tuple[float, float] = (math.radians(-90), math.radians(30)),
        yaw_limit_rad: float = math.radians(150),
        response_s: float = 0.1,
        rate_max_rps: float = math.radians(180),
        attitude_hz: float = 10.0,
    ) -> None:
        self.pitch_rad, self.yaw_rad = pitch_rad, 0.0
        self.rates_rps = (0.0, 0.0)  # pitch, yaw
        self.command: tuple[str, float, float] = ("rate", 0.0, 0.0)  # or "angle", what stays in force
        self.locked = False
        self.primary = self.secondary = _NOBODY  # (system, component) in control
        self.silent = False
        self.grants = True  # False: nobody is given control
        self.refused = 0  # commands of those who are not in control
        self._has_yaw, self._can_lock, self._earth_frame = has_yaw, yaw_lock, earth_frame
        self._pitch_limits_rad, self._yaw_limit_rad = pitch_limits_rad, yaw_limit_rad
        self._response_s, self._rate_max_rps = response_s, rate_max_rps
        self._interval_s = {_ATTITUDE: 1.0 / attitude_hz, _STATUS: 1.0 / _STATUS_HZ}
        self._due_s = {_ATTITUDE: 0.0, _STATUS: 0.0}
        self._vehicle_yaw_rad: float | None = None
        self._t_s = self._boot_s = -1.0
        self._manager: Outbox | None = None
        self._device: Outbox | None = None

    def attach(self, manager: Outbox) -> None:
        """manager: where the autopilot's own messages go."""
        self._manager = manager
        self._device = Outbox(manager.system_id, DEVICE_ID, manager.random, manager.signing, manager.faults)

    @property
    def relative_yaw_rad(self) -> float:
        """Against the vehicle's nose."""
        return _wrap(self.yaw_rad - (self._vehicle_yaw_rad or 0.0))

    @property
    def rpy_rad(self) -> Vec3:
        """The camera's roll, pitch and yaw in NED."""
        return 0.0, self.pitch_rad, self.yaw_rad

    # -- motion -------------------------------------------------------------------------------------------

    def tick(self, now_s: float, motion: Motion) -> None:
        """Advance with the vehicle, and send what is due."""
        if self._vehicle_yaw_rad is None:
            self.yaw_rad, self._boot_s = _wrap(motion.yaw_rad + self.yaw_rad), now_s
        else:
            self._turn(now_s - self._t_s, motion.yaw_rad - self._vehicle_yaw_rad)
        self._vehicle_yaw_rad, self._t_s = motion.yaw_rad, now_s
        self._stop_at_stops()
        for number, due_s in self._due_s.items():
            if now_s >= due_s - 1e-9:
                self._due_s[number] = max(due_s + self._interval_s[number], now_s)
                self._send(number, now_s)

    def _turn(self, dt_s: float, carried_rad: float) -> None:
        """carried_rad: how far the vehicle has turned meanwhile, which a locked yaw does not notice."""
        kind, *wanted = self.command
        if kind == "angle":
            now = (self.pitch_rad, self.yaw_rad if self.locked else self.relative_yaw_rad)
            wanted = [_ANGLE_GAIN_PS * _wrap(w - n) for w, n in zip(wanted, now, strict=True)]
        k = 1.0 - math.exp(-dt_s / self._response_s)
        most = self._rate_max_rps
        pitch, yaw = (r + k * (min(max(w, -most), most) - r) for r, w in zip(self.rates_rps, wanted, strict=True))
        self.rates_rps = pitch, yaw
        self.pitch_rad += pitch * dt_s
        if not self._has_yaw:
            self.yaw_rad += carried_rad
        else:
            self.yaw_rad = _wrap(self.yaw_rad + yaw * dt_s + (0.0 if self.locked else carried_rad))

    def _stop_at_stops(self) -> None:
        low, high = self._pitch_limits_rad
        self.pitch_rad = min(max(self.pitch_rad, low), high)
        relative = self.relative_yaw_rad
        if abs(relative) > self._yaw_limit_rad:
            stop = math.copysign(self._yaw_limit_rad, relative)
            self.yaw_rad = _wrap((self._vehicle_yaw_rad or 0.0) + stop)

    # -- messages -----------------------------------------------------------------------------------------

    def flush(self, now_s: float, unix_s: float) -> list[bytes]:
        """The device's own datagrams; the manager's leave with the autopilot's."""
        return [] if self._device is None or self.silent else self._device.flush(now_s, unix_s)

    def handle(self, message: Any, now_s: float) -> bool:
        """Whether the message was for the gimbal or its manager."""
        kind = message.get_type()
        if kind in ("GIMBAL_MANAGER_SET_PITCHYAW", "GIMBAL_MANAGER_SET_ATTITUDE"):
            if message.gimbal_device_id in (0, DEVICE_ID) and self._obeys(message):
                self._set(message)
            return True
        return kind == "COMMAND_LONG" and self._command(message, now_s)

    def _obeys(self, message: Any) -> bool:
        allowed = (message.get_srcSystem(), message.get_srcComponent()) in (self.primary, self.secondary)
        self.refused += not allowed
        return allowed

    def _set(self, message: Any) -> None:
        """Angles where they are numbers, else rates; NaN of both leaves an axis alone."""
        self.locked = bool(message.flags & _YAW_LOCK) and self._can_lock
        if message.get_msgId() == _SET_PITCHYAW:
            angles, rates = (message.pitch, message.yaw), (message.pitch_rate, message.yaw_rate)
        else:
            w, x, y, z = message.q
            yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            sine = 2 * (w * y - z * x)
            angles = (math.asin(min(max(sine, -1.0), 1.0)) if math.isfinite(sine) else math.nan, yaw)
            rates = (message.angular_velocity_y, message.angular_velocity_z)
        self._take(angles, rates)

    def _take(self, angles: tuple[float, float], rates: tuple[float, float]) -> None:
        if all(map(math.isfinite, angles)):
            self.command = ("angle", *angles)
        else:
            pitch, yaw = (r if math.isfinite(r) else 0.0 for r in rates)
            self.command = ("rate", pitch, yaw)

    def _command(self, message: Any, now_s: float) -> bool:
        assert self._manager is not None
        assert self._device is not None
        if message.target_system not in (0, self._manager.system_id):
            return False
        params = [getattr(message, f"param{number}") for number in range(1, 8)]
        result, at = None, self._manager
        if message.target_component == DEVICE_ID:
            result, at = self._of_device(message.command, params, now_s), self._device
        elif message.target_component in (0, self._manager.component_id):
            result = self._of_manager(message, params, now_s)
        if result is None:
            return False
        if not self.silent:
            sender = message.get_srcSystem(), message.get_srcComponent()
            due_s = self._manager.answer_time_s(now_s)
            at.put(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *sender), due_s)
        return True

    def _of_device(self, command: int, params: Sequence[float], now_s: float) -> Result | None:
        if command == _REQUEST and params[0] in (_DEVICE_INFORMATION, _ATTITUDE):
            self._send(round(params[0]), now_s)
            return Result.ACCEPTED
        if command == _SET_INTERVAL and params[0] == _ATTITUDE and params[1] > 0.0:
            self._interval_s[_ATTITUDE], self._due_s[_ATTITUDE] = params[1] * 1e-6, now_s
            return Result.ACCEPTED
        return Result.UNSUPPORTED

    def _of_manager(self, message: Any, params: Sequence[float], now_s: float) -> Result | None:
        match message.command:
            case 512 if params[0] in (_INFORMATION, _STATUS):
                self._send(round(params[0]), now_s)
            case 511 if params[0] == _STATUS and params[1] > 0.0:
                self._interval_s[_STATUS], self._due_s[_STATUS] = params[1] * 1e-6, now_s
            case 1001:
                return self._configure(message, params, now_s)
            case 1000:
                if not self._obeys(message):
                    return Result.DENIED
                self.locked = bool(int(params[4]) & _YAW_LOCK) and self._can_lock
                pitch, yaw, pitch_rate, yaw_rate = (math.radians(p) for p in params[:4])
                self._take((pitch, yaw), (pitch_rate, yaw_rate))
            case _:
                return None
        return Result.ACCEPTED

    def _configure(self, message: Any, params: Sequence[float], now_s: float) -> Result:
        """MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: who is in control, the last who asks."""
        if not self.grants:
            return Result.DENIED
        sender = message.get_srcSystem(), message.get_srcComponent()
        self.primary = _holder(self.primary, params[:2], sender)
        self.secondary = _holder(self.secondary, params[2:4], sender)
        self._send(_STATUS, now_s)
        return Result.ACCEPTED

    def _send(self, number: int, now_s: float) -> None:
        if self.silent or self._manager is None or self._device is None:
            return
        at = self._device if number in (_ATTITUDE, _DEVICE_INFORMATION) else self._manager
        at.put(self._message(number, round((now_s - self._boot_s) * 1e3) & 0xFFFFFFFF), now_s)

    def _message(self, number: int, boot_ms: int) -> Any:
        capabilities = _CAPABILITIES | (_YAW_CAPABILITIES if self._has_yaw else 0)
        capabilities |= _YAW_LOCK_CAPABILITY if self._has_yaw and self._can_lock else 0
        yaw_rad = self._yaw_limit_rad if self._has_yaw else 0.0
        limits = (0.0, 0.0, *self._pitch_limits_rad, -yaw_rad, yaw_rad)
        if number == _INFORMATION:
            return mavlink.MAVLink_gimbal_manager_information_message(boot_ms, capabilities, DEVICE_ID, *limits)
        if number == _STATUS:
            flags = _LOCKS | (_YAW_LOCK if self.locked else 0)
            return mavlink.MAVLink_gimbal_manager_status_message(
                boot_ms, flags, DEVICE_ID, *self.primary, *self.secondary
            )
        if number == _DEVICE_INFORMATION:
            names = (b"mock", b"two axes", b"")
            return mavlink.MAVLink_gimbal_device_information_message(
                boot_ms, *names, 1, 1, 1, capabilities & 0xFFFF, 0, *limits
            )
        yaw_rad = self.yaw_rad if self._earth_frame else self.relative_yaw_rad
        flags = _LOCKS | (_YAW_LOCK if self.locked else 0) | (_IN_EARTH if self._earth_frame else _IN_VEHICLE)
        pitch_rps, yaw_rps = self.rates_rps
        q = quaternion(0.0, self.pitch_rad, yaw_rad)
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, boot_ms, flags, q, 0.0, pitch_rps, yaw_rps, 0
        )


def _holder(now: tuple[int, int], params: Sequence[float], sender: tuple[int, int]) -> tuple[int, int]:
    if _LEAVE in params:
        return now
    if _REMOVE in params:
        return _NOBODY if now == sender else now
    return int(params[0]), int(params[1])
