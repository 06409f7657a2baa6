"""A point-mass multicopter with the velocity responses measured on PX4 and ArduCopter in SITL.

Every axis follows one law: after a dead time the wanted acceleration is `gain · velocity error`, limited, and
the real acceleration approaches it at `accel_gain`, limited in jerk. Unlimited, that is the second-order fit
of the measured step responses (for PX4 horizontally the same curve as 0.20 s dead time + 0.48 s first order,
but with an acceleration, and so a tilt, that has no jumps). Frames: NED, origin at home; roll, pitch, yaw ZYX.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass, field

Vec3 = tuple[float, float, float]

GRAVITY_MPS2 = 9.80665
TICK_S = 0.005
MAX_CATCH_UP_S = 5.0


@dataclass(frozen=True, slots=True)
class Response:
    """How one axis follows its command: dead time (s), gains (1/s), limits in the axis's own units."""

    delay_s: float
    gain_ps: float
    accel_gain_ps: float
    accel_max: float
    jerk_max: float


@dataclass(frozen=True, slots=True)
class Airframe:
    """The responses and speed limits of one autopilot with its default parameters."""

    horizontal: Response
    vertical: Response
    yaw: Response
    yaw_angle_wn_rps: float
    yaw_angle_zeta: float
    yaw_angle_delay_s: float
    speed_max_mps: float
    climb_max_mps: float
    descent_max_mps: float
    yaw_rate_max_rps: float
    drag_ps: float = 0.2
    coast_tau_s: float = 4.3  # decay of the speed when nothing controls the horizontal axes


PX4 = Airframe(
    horizontal=Response(0.09, 1.70, 8.97, 9.0, 37.0),
    vertical=Response(0.05, 4.1, 30.0, 6.5, 60.0),
    yaw=Response(0.04, 2.2, 40.0, math.radians(320), math.inf),
    yaw_angle_wn_rps=3.2,
    yaw_angle_zeta=0.68,
    yaw_angle_delay_s=0.2,
    speed_max_mps=12.0,
    climb_max_mps=3.0,
    descent_max_mps=1.5,
    yaw_rate_max_rps=math.radians(200),
)
ARDUPILOT = Airframe(
    horizontal=Response(0.13, 2.1, 30.0, 2.5, 5.6),
    vertical=Response(0.08, 3.0, 30.0, 1.13, 3.9),
    yaw=Response(0.05, 6.4, 4.73, math.radians(220), math.inf),
    yaw_angle_wn_rps=3.2,
    yaw_angle_zeta=0.8,
    yaw_angle_delay_s=0.2,
    speed_max_mps=10.0,
    climb_max_mps=5.0,
    descent_max_mps=2.5,
    yaw_rate_max_rps=math.radians(60),
)


@dataclass(frozen=True, slots=True)
class MotionCommand:
    """Velocity in NED (m/s); NaN north or east = horizontal axes uncontrolled. yaw_rad wins over the rate."""

    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    yaw_rate_rps: float = 0.0
    yaw_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Steady wind (tilts the vehicle) and a seeded wander of the velocity, standard deviation in m/s."""

    wind_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    wander_std_mps: float = 0.0
    wander_tau_s: float = 4.0
    seed: int = 0


@dataclass(slots=True)
class Motion:
    """True motion: NED metres, m/s, m/s²; Euler angles rad; body rates rad/s."""

    position_ned_m: Vec3 = (0.0, 0.0, 0.0)
    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    accel_ned_mps2: Vec3 = (0.0, 0.0, 0.0)
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    yaw_rate_rps: float = 0.0
    yaw_accel_rps2: float = 0.0
    body_rates_rps: Vec3 = (0.0, 0.0, 0.0)
    on_ground: bool = True


def wrap_pi(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def body_to_ned(velocity_frd_mps: Vec3, yaw_rad: float) -> Vec3:
    """A level body-frame vector in NED: the autopilots turn setpoints by yaw alone."""
    forward, right, down = velocity_frd_mps
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * forward - s * right, s * forward + c * right, down


def _limit_norm(x: float, y: float, limit: float) -> tuple[float, float]:
    norm = math.hypot(x, y)
    if norm <= limit or norm == 0.0:
        return x, y
    return x * limit / norm, y * limit / norm


def _clamp(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


def _axis(response: Response, error: float, accel: float, tick_s: float) -> float:
    """The next acceleration of a single axis after one tick."""
    wanted = _clamp(response.gain_ps * error, -response.accel_max, response.accel_max)
    jerk = _clamp(response.accel_gain_ps * (wanted - accel), -response.jerk_max, response.jerk_max)
    return accel + jerk * tick_s


@dataclass(slots=True)
class Multicopter:
    """Advance with `step(dt_s, command)`; read `motion`. Deterministic for a seed and a list of calls.

    tick_s: the time step; 10 ms is the coarsest that still gives the measured responses.
    """

    airframe: Airframe = PX4
    disturbance: Disturbance = field(default_factory=Disturbance)
    motion: Motion = field(default_factory=Motion)
    ground_down_m: float = 0.0
    tick_s: float = TICK_S
    _history: deque[MotionCommand] = field(init=False)
    _at: tuple[int, int, int, int] = field(init=False)  # where in the history each axis's dead time ends
    _carry_s: float = field(init=False, default=0.0)
    _random: random.Random = field(init=False)
    _wander: Vec3 = field(init=False, default=(0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        frame = self.airframe
        delays_s = (frame.horizontal.delay_s, frame.vertical.delay_s, frame.yaw.delay_s, frame.yaw_angle_delay_s)
        horizontal, vertical, yaw, yaw_angle = (-1 - round(delay_s / self.tick_s) for delay_s in delays_s)
        self._at = (horizontal, vertical, yaw, yaw_angle)
        ticks = -min(self._at)
        self._history = deque([MotionCommand()] * ticks, maxlen=ticks)
        self._random = random.Random(self.disturbance.seed)

    def step(self, dt_s: float, command: MotionCommand | None) -> Motion:
        """Advance dt_s (s) in fixed ticks, the remainder is carried over; None = motors off, stays put.

        Raises ValueError for a negative or non-finite dt_s.
        """
        if not (math.isfinite(dt_s) and dt_s >= 0.0):
            raise ValueError(f"dt_s must be a finite time >= 0, got {dt_s}")
        self._carry_s += min(dt_s, MAX_CATCH_UP_S)
        while self._carry_s >= self.tick_s - 1e-9:
            self._carry_s -= self.tick_s
            self.tick(command)
        return self.motion

    def tick(self, command: MotionCommand | None) -> None:
        """Advance by exactly tick_s."""
        if command is None:
            self._rest()
            return
        self._history.append(command)
        self._yaw()
        self._horizontal()
        self._vertical()
        self._integrate()
        self._attitude()

    def _rest(self) -> None:
        motion = self.motion
        self._history.append(MotionCommand())
        motion.velocity_ned_mps = motion.accel_ned_mps2 = motion.body_rates_rps = (0.0, 0.0, 0.0)
        motion.roll_rad = motion.pitch_rad = motion.yaw_rate_rps = motion.yaw_accel_rps2 = 0.0
        motion.on_ground = True

    def _yaw(self) -> None:
        frame, motion = self.airframe, self.motion
        target = self._history[self._at[3]].yaw_rad
        if self._history[-1].yaw_rad is not None and target is not None:
            wn, zeta = frame.yaw_angle_wn_rps, frame.yaw_angle_zeta
            error = wrap_pi(target - motion.yaw_rad)
            motion.yaw_accel_rps2 = wn * wn * error - 2.0 * zeta * wn * motion.yaw_rate_rps
        else:
            limit = frame.yaw_rate_max_rps
            wanted = _clamp(self._history[self._at[2]].yaw_rate_rps, -limit, limit)
            motion.yaw_accel_rps2 = _axis(frame.yaw, wanted - motion.yaw_rate_rps, motion.yaw_accel_rps2, self.tick_s)

    def _horizontal(self) -> None:
        frame, motion = self.airframe, self.motion
        vx, vy, _ = motion.velocity_ned_mps
        ax, ay, az = motion.accel_ned_mps2
        cx, cy, _ = self._history[self._at[0]].velocity_ned_mps
        if math.isnan(cx) or math.isnan(cy):
            motion.accel_ned_mps2 = (-vx / frame.coast_tau_s, -vy / frame.coast_tau_s, az)
            return
        r = frame.horizontal
        cx, cy = _limit_norm(cx, cy, frame.speed_max_mps)
        wx, wy = _limit_norm(r.gain_ps * (cx - vx), r.gain_ps * (cy - vy), r.accel_max)
        jx, jy = _limit_norm(r.accel_gain_ps * (wx - ax), r.accel_gain_ps * (wy - ay), r.jerk_max)
        motion.accel_ned_mps2 = (ax + jx * self.tick_s, ay + jy * self.tick_s, az)

    def _vertical(self) -> None:
        frame, motion = self.airframe, self.motion
        wanted = self._history[self._at[1]].velocity_ned_mps[2]
        wanted = 0.0 if math.isnan(wanted) else _clamp(wanted, -frame.climb_max_mps, frame.descent_max_mps)
        ax, ay, az = motion.accel_ned_mps2
        motion.accel_ned_mps2 = (ax, ay, _axis(frame.vertical, wanted - motion.velocity_ned_mps[2], az, self.tick_s))

    def _integrate(self) -> None:
        motion = self.motion
        a, v, p = motion.accel_ned_mps2, motion.velocity_ned_mps, motion.position_ned_m
        v = (v[0] + a[0] * self.tick_s, v[1] + a[1] * self.tick_s, v[2] + a[2] * self.tick_s)
        w = self._next_wander()
        p = (p[0] + (v[0] + w[0]) * self.tick_s, p[1] + (v[1] + w[1]) * self.tick_s, p[2] + (v[2] + w[2]) * self.tick_s)
        motion.on_ground = p[2] >= self.ground_down_m - 1e-6 and v[2] >= -1e-3
        if motion.on_ground:
            p, v = (motion.position_ned_m[0], motion.position_ned_m[1], self.ground_down_m), (0.0, 0.0, 0.0)
            motion.accel_ned_mps2 = (0.0, 0.0, a[2] if a[2] < 0.0 else 0.0)
            motion.yaw_accel_rps2 = motion.yaw_rate_rps = 0.0
        motion.position_ned_m, motion.velocity_ned_mps = p, v
        limit = self.airframe.yaw_rate_max_rps
        motion.yaw_rate_rps += motion.yaw_accel_rps2 * self.tick_s
        motion.yaw_rate_rps = _clamp(motion.yaw_rate_rps, -1.3 * limit, 1.3 * limit)
        motion.yaw_rad = wrap_pi(motion.yaw_rad + motion.yaw_rate_rps * self.tick_s)

    def _next_wander(self) -> Vec3:
        std, tau = self.disturbance.wander_std_mps, self.disturbance.wander_tau_s
        if std <= 0.0 or self.motion.on_ground:
            return (0.0, 0.0, 0.0)
        keep, kick = 1.0 - self.tick_s / tau, std * math.sqrt(2.0 * self.tick_s / tau)
        w = self._wander
        gauss = self._random.gauss
        self._wander = (
            keep * w[0] + kick * gauss(0.0, 1.0),
            keep * w[1] + kick * gauss(0.0, 1.0),
            keep * w[2] + kick * gauss(0.0, 1.0),
        )
        return self._wander

    def _attitude(self) -> None:
        """Roll and pitch that give the thrust for the acceleration, against the drag of the moving air."""
        motion, drag = self.motion, self.airframe.drag_ps
        a, v, wind = motion.accel_ned_mps2, motion.velocity_ned_mps, self.disturbance.wind_ned_mps
        if motion.on_ground:
            roll = pitch = 0.0
        else:
            north = a[0] + drag * (v[0] - wind[0])
            east = a[1] + drag * (v[1] - wind[1])
            c, s = math.cos(motion.yaw_rad), math.sin(motion.yaw_rad)
            up = max(GRAVITY_MPS2 - a[2], 3.0)
            pitch = -math.atan2(c * north + s * east, up)
            roll = math.atan2((c * east - s * north) * math.cos(pitch), up)
        roll_rate = (roll - motion.roll_rad) / self.tick_s
        pitch_rate = (pitch - motion.pitch_rad) / self.tick_s
        motion.roll_rad, motion.pitch_rad = roll, pitch
        motion.body_rates_rps = _body_rates(roll, pitch, roll_rate, pitch_rate, motion.yaw_rate_rps)


def _body_rates(roll: float, pitch: float, roll_rate: float, pitch_rate: float, yaw_rate: float) -> Vec3:
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    return (
        roll_rate - sp * yaw_rate,
        cr * pitch_rate + sr * cp * yaw_rate,
        cr * cp * yaw_rate - sr * pitch_rate,
    )
