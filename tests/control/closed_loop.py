"""A lockstep closed loop with a vehicle, camera and target of its own, sharing no code with control/.

Vehicle as measured on PX4: dead time 0.20 s + 0.48 s horizontally, 0.05 + 0.45 s in yaw rate, 0.09 + 0.20 s
vertically; it leans into its acceleration. Pictures at `fps`, delay_s late, with pixel noise on the box.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from control.attitude import AttitudeBuffer
from control.camera import CameraModel, bearing_measurement
from control.camera_check import CameraCheck, Verdict
from control.config import ControlConfig
from control.estimator import TargetEstimator
from control.fence import Fence
from control.follow import FollowState, follow_request
from control.gate import Limits, Reason, Setpoint, gate
from control.limits import zero_request
from control.modes import FollowMode, confirm
from control.types import VehicleMode, VehicleState

DT_S = 0.01
Position = tuple[float, float]
Path = Callable[[float], Position]


@dataclass
class Lag:
    """Dead time, then first order."""

    dead_s: float
    tau_s: float
    value: float = 0.0
    line: deque[float] = field(default_factory=deque)

    def step(self, command: float) -> float:
        """Advance by DT_S; the value after it."""
        self.line.append(command)
        due = self.line.popleft() if len(self.line) > round(self.dead_s / DT_S) else 0.0
        self.value += (due - self.value) * (1 - math.exp(-DT_S / self.tau_s))
        return self.value


@dataclass
class Vehicle:
    """Point mass that leans: pitch from the acceleration along the nose, roll from that across it."""

    height_m: float = 5.0
    north_m: float = 0.0
    east_m: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    vn: Lag = field(default_factory=lambda: Lag(0.20, 0.48))
    ve: Lag = field(default_factory=lambda: Lag(0.20, 0.48))
    vd: Lag = field(default_factory=lambda: Lag(0.09, 0.20))
    yaw_rate: Lag = field(default_factory=lambda: Lag(0.05, 0.45))

    def step(self, velocity_ned: tuple[float, float, float], yaw_rate_rps: float) -> None:
        """Advance by DT_S under this setpoint."""
        before = self.vn.value, self.ve.value
        vn, ve = self.vn.step(velocity_ned[0]), self.ve.step(velocity_ned[1])
        vd = self.vd.step(velocity_ned[2])
        an, ae = (vn - before[0]) / DT_S, (ve - before[1]) / DT_S
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        pitch, roll = -math.atan((an * c + ae * s) / 9.81), math.atan((ae * c - an * s) / 9.81)
        self.pitch_rad += (pitch - self.pitch_rad) * DT_S / 0.1
        self.roll_rad += (roll - self.roll_rad) * DT_S / 0.1
        self.north_m += vn * DT_S
        self.east_m += ve * DT_S
        self.height_m -= vd * DT_S
        self.yaw_rad += self.yaw_rate.step(yaw_rate_rps) * DT_S


@dataclass(frozen=True)
class Setup:
    """What varies between runs."""

    mode: FollowMode = FollowMode.FOLLOW
    fps: float = 20.0
    delay_s: float = 0.1
    delay_error_s: float = 0.0  # so much more of it is believed in
    noise_px: float = 2.0
    duration_s: float = 40.0
    settle_s: float = 6.0
    hidden: tuple[float, float] = (0.0, 0.0)
    seed: int = 1
    hfov_rad: float = math.radians(75)
    size_m: tuple[float, float] = (0.6, 1.8)
    mount_pitch_rad: float = math.radians(-15)
    camera: str = "right"  # or mirrored, upside down, on a gimbal: nothing the station knows of
    config: ControlConfig = field(default_factory=lambda: ControlConfig(limits=Limits(fence=Fence(radius_m=500))))


@dataclass
class Result:
    """Errors after settling."""

    bearing_rms_deg: float
    distance_rms_frac: float
    smallest_distance_m: float
    seen_frac: float
    trims: int
    largest_speed_mps: float
    last_bearing_deg: float
    verdict: Verdict  # on the camera
    verdict_s: float | None  # after the confirmation
    largest_odds: float  # against a right camera
    yaw_rate_rms_dps: float  # as commanded


def see(vehicle: Vehicle, target: Position, setup: Setup, rng: random.Random) -> tuple[float, ...] | None:
    """Box (cx, cy, w, h) px in the picture of the camera as it really is, None if outside."""
    if setup.camera == "on a gimbal":
        vehicle = replace(vehicle, yaw_rad=0.0)
    box = right_box(vehicle, target, setup, rng)
    if box is None or setup.camera in ("right", "on a gimbal"):
        return box
    u, v, w, h = box
    return 640 - u, (v if setup.camera == "mirrored" else 480 - v), w, h


def right_box(vehicle: Vehicle, target: Position, setup: Setup, rng: random.Random) -> tuple[float, ...] | None:
    """Box (cx, cy, w, h) px of an upright target on the ground in a 640 x 480 picture, None if outside."""
    n, e, d = target[0] - vehicle.north_m, target[1] - vehicle.east_m, vehicle.height_m - setup.size_m[1] / 2
    c, s = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
    forward, right = n * c + e * s, e * c - n * s
    c, s = math.cos(vehicle.pitch_rad), math.sin(vehicle.pitch_rad)
    forward, down = forward * c - d * s, forward * s + d * c
    c, s = math.cos(vehicle.roll_rad), math.sin(vehicle.roll_rad)
    right, down = right * c + down * s, down * c - right * s
    c, s = math.cos(setup.mount_pitch_rad), math.sin(setup.mount_pitch_rad)
    forward, down = forward * c - down * s, forward * s + down * c
    if forward < 0.5:
        return None
    focal = 320 / math.tan(setup.hfov_rad / 2)
    u, v = 320 + focal * right / forward, 240 + focal * down / forward
    w, h = (focal * size / forward for size in setup.size_m)
    if not (0 < u < 640 and 0 < v < 480):
        return None
    noise = [rng.gauss(0, setup.noise_px) for _ in range(4)]
    return u + noise[0], v + noise[1], max(w + noise[2], 3.0), max(h + noise[3], 3.0)


def fly(path: Path, setup: Setup) -> Result:
    """Fly the whole run and measure it against the truth."""
    rng = random.Random(setup.seed)
    config, vehicle, estimator, attitude = setup.config, Vehicle(), TargetEstimator(), AttitudeBuffer()
    estimator = TargetEstimator(config.estimator)
    mount = (0.0, setup.mount_pitch_rad, 0.0)
    camera = CameraModel.from_hfov(640, 480, setup.hfov_rad, mount_rpy_rad=mount)
    frames: deque[tuple[float, tuple[float, ...] | None]] = deque()
    telemetry: deque[tuple[float, VehicleState]] = deque()
    state, shaping, confirmed = VehicleState(), FollowState.at_rest(0.0), None
    setpoint: Setpoint | None = None
    rates: list[float] = []
    bearings, distances, seen, trims, smallest, fastest = [], [], 0, 0, math.inf, 0.0
    frame_count, start_m = 0, 0.0
    check, verdict_s, odds = CameraCheck(), None, -math.inf
    for tick in range(round(setup.duration_s / DT_S)):
        now = tick * DT_S
        target = path(now)
        command = (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) if setpoint else ((0.0, 0.0, 0.0), 0.0)
        vehicle.step(*command)
        gap = target[0] - vehicle.north_m, target[1] - vehicle.east_m
        smallest = min(smallest, math.hypot(*gap))
        if tick % 2 == 0:
            telemetry.append((now + 0.03, telemetry_of(vehicle, now)))
        while telemetry and telemetry[0][0] <= now + 1e-9:
            arrival, state = telemetry.popleft()
            attitude.add(arrival - 0.03, state.roll_rad, state.pitch_rad, state.yaw_rad)
        if now >= frame_count / setup.fps:
            frame_count += 1
            hidden = setup.hidden[0] <= now < setup.hidden[1]
            box = None if hidden else see(vehicle, target, setup, rng)
            frames.append((now, box))
        while frames and frames[0][0] + setup.delay_s <= now + 1e-9:
            captured, box = frames.popleft()
            captured -= setup.delay_error_s
            angles = attitude.at(captured)
            if box is not None and angles is not None:
                measurement = bearing_measurement(camera, *box, angles, captured, 0.9)
                if estimator.update(measurement):
                    check.saw(measurement, angles[2])
                    odds = max(odds, check.odds)
                if verdict_s is None and check.verdict is not Verdict.OPEN:
                    verdict_s = now - 1.0
        if tick % 5 == 0:
            predicted = estimator.predict(now + config.follow.lead_s)
            if predicted is not None and now >= 1.0:
                if confirmed is None:
                    start_m = math.hypot(*gap)
                    confirmed = confirm(setup.mode, predicted, state, now, config.follow, distance_m=start_m)
                unseen = now - predicted.measured_t_s - setup.delay_s
                factor = min(max((1.0 - unseen) / 0.7, 0.0), 1.0)
                request, shaping = follow_request(
                    confirmed, predicted, state, camera, now, shaping, config,
                    velocity_factor=factor, coasting=unseen > 0.3,
                )  # fmt: skip
                if factor == 0.0:  # what the state machine does once the target is lost
                    request, shaping = zero_request(now), FollowState.at_rest(now)
                setpoint, reason = gate(request, state, now, setpoint, config.limits)
                trims += reason is not Reason.PASSED
        if now >= setup.settle_s and tick % 5 == 0:
            bearing = math.atan2(gap[1], gap[0]) - vehicle.yaw_rad
            bearings.append(math.degrees(math.remainder(bearing, 2 * math.pi)))
            distances.append(math.hypot(*gap) / start_m - 1)
            rates.append(setpoint.yaw_rate_rps if setpoint else 0.0)
            seen += see(vehicle, target, setup, random.Random(0)) is not None
            fastest = max(fastest, math.hypot(vehicle.vn.value, vehicle.ve.value))
    return Result(
        _rms(bearings), _rms(distances), smallest, seen / len(bearings), trims, fastest, bearings[-1],
        check.verdict, verdict_s, odds, math.degrees(_rms(rates)),
    )  # fmt: skip


def telemetry_of(vehicle: Vehicle, now: float) -> VehicleState:
    """What the vehicle would report now: all fresh, and ours."""
    stamp = now
    return VehicleState(
        heartbeat_t_s=stamp, mode=VehicleMode.EXTERNAL, mode_t_s=stamp, armed=True, in_air=True,
        attitude_t_s=stamp, roll_rad=vehicle.roll_rad, pitch_rad=vehicle.pitch_rad,
        yaw_rad=math.remainder(vehicle.yaw_rad, 2 * math.pi), yaw_rate_rps=vehicle.yaw_rate.value,
        position_t_s=stamp, position_ned_m=(vehicle.north_m, vehicle.east_m, -vehicle.height_m),
        velocity_ned_mps=(vehicle.vn.value, vehicle.ve.value, vehicle.vd.value), height_m=vehicle.height_m,
    )  # fmt: skip


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))


def sine(t: float) -> Position:
    """Across at 15 m, 5 m/s at the fastest."""
    return 15.0, 8.0 * math.sin(5.0 / 8.0 * t)


def zigzag(t: float) -> Position:
    """Across at 15 m, always 5 m/s, turning on the spot every 4 s."""
    phase = (t * 5.0 / 40.0 + 0.25) % 1.0
    return 15.0, 10.0 * (4 * abs(phase - 0.5) - 1) * -1


def runner(t: float) -> Position:
    """Away to the north at 4 m/s from the second second on, weaving."""
    return 15.0 + 4.0 * max(t - 2.0, 0.0), 3.0 * math.sin(0.5 * t)


def zigzag_away(t: float) -> Position:
    """5 m/s over ground, heading +-45 degrees of north, turning every 4 s."""
    side = zigzag(t)[1] * math.sqrt(0.5)
    return 15.0 + 5.0 * math.sqrt(0.5) * t, side


def standing(t: float) -> Position:
    """Not moving."""
    return 15.0, 0.0
