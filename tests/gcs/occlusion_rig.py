"""A flight behind a car that a straight edge covers, in lockstep: whole control side, no I/O.

The vehicle is the one of tests/control/closed_loop; the car is a box of its own, seen through a pinhole written
out here. The tracker is as confident of a covered car as of a whole one: its box is what is left to be seen.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from control.attitude import AttitudeBuffer
from control.camera import CameraModel
from control.config import ControlConfig
from control.engagement import State
from control.fence import Fence
from control.gate import Limits
from control.types import TargetState, VehicleMode, VehicleState
from gcs.flight_control import Act, FollowControl, Wanted
from gcs.flight_vision import Seen
from gcs.video import Frame
from tests.control.closed_loop import DT_S, Vehicle, telemetry_of
from tracker.box import Box, TrackResult

HEIGHT_M, START_M = 9.0, 16.0
MOUNT_PITCH_RAD, FOCAL_PX = math.radians(-28), 320 / math.tan(math.radians(35))
CAMERA = CameraModel.from_hfov(640, 480, math.radians(70), mount_rpy_rad=(0.0, MOUNT_PITCH_RAD, 0.0))
CAR_M = (4.2, 1.8, 1.5)  # length, width, height
_BLANK = np.zeros((4, 4, 3), np.uint8)
_LEAST_VISIBLE = 0.12  # of the box: less and the tracker gives nothing
_CONFIRM_S, _DRIVE_S = 4.0, 6.0


class Side(Enum):
    """From where the edge comes."""

    TOP = "top"  # a bridge, driven under
    BOTTOM = "bottom"
    LEFT = "left"  # a lorry passing
    RIGHT = "right"


@dataclass(frozen=True)
class Cover:
    """An edge that comes over the car within cover_s, hides it for gone_s, and goes on over the other side.

    depth: how much of the box it hides; a part only, and it goes back the way it came.
    """

    side: Side = Side.TOP
    from_s: float = 25.0
    cover_s: float = 0.5
    gone_s: float = 0.9
    depth: float = 1.0

    @property
    def until_s(self) -> float:
        """When the car is whole again."""
        return self.from_s + 2 * self.cover_s + self.gone_s

    def visible(self, t_s: float) -> tuple[float, float]:
        """What part of the box is left, from 0 (the side the edge comes from) to 1."""
        covered = min(max((t_s - self.from_s) / self.cover_s, 0.0), 1.0)
        freed = min(max((t_s - self.until_s + self.cover_s) / self.cover_s, 0.0), 1.0)
        if self.depth < 1.0:
            return self.depth * (covered - freed), 1.0
        return (covered, 1.0) if freed == 0.0 else (0.0, freed)

    def cut(self, box: Box, t_s: float) -> Box | None:
        """What is left of the box at t_s; None when too little."""
        low, high = self.visible(t_s)
        if high - low < _LEAST_VISIBLE:
            return None
        if self.side in (Side.BOTTOM, Side.RIGHT):
            low, high = 1 - high, 1 - low
        if self.side in (Side.TOP, Side.BOTTOM):
            middle = box.cy_px + ((low + high) / 2 - 0.5) * box.h_px
            return replace(box, cy_px=middle, h_px=box.h_px * (high - low))
        middle = box.cx_px + ((low + high) / 2 - 0.5) * box.w_px
        return replace(box, cx_px=middle, w_px=box.w_px * (high - low))


@dataclass(frozen=True)
class Flight:
    """What varies between flights."""

    speed_mps: float = 4.0
    cover: Cover | None = field(default_factory=Cover)
    delay_s: float = 0.1
    noise_px: float = 2.0
    duration_s: float = 42.0
    seed: int = 1
    standoff_m: float | None = None
    circle_from_s: float = math.inf  # from then on it drives a circle to the right
    radius_m: float = 16.0
    config: ControlConfig = field(default_factory=lambda: ControlConfig(limits=Limits(fence=Fence(radius_m=500.0))))


@dataclass(frozen=True)
class Row:
    """The truth of one tick, and what was made of it."""

    t_s: float
    distance_m: float
    bearing_deg: float
    speed_mps: float
    state: State
    target: TargetState | None
    rejections: int


@dataclass(frozen=True)
class Outcome:
    """Distance errors as a share of what it was just before the edge came.

    recovery_s: from the car being whole again to the distance being within 10 %, after the largest error.
    """

    rows: list[Row]
    peak_frac: float
    recovery_s: float
    lowest_frac: float
    most_rejections: int
    bearing_peak_deg: float
    fastest_mps: float
    end_state: State


@dataclass(frozen=True)
class Car:
    """Where it is and heads."""

    north_m: float
    east_m: float = 0.0
    heading_rad: float = 0.0


def car_box(vehicle: Vehicle, car: Car, rng: random.Random, noise_px: float) -> Box | None:
    """The box around the car's eight corners in a 640 x 480 picture."""
    length, width, height = CAR_M
    us, vs = [], []
    for corner in range(8):
        along, across = (length / 2 if corner & 1 else -length / 2), (width / 2 if corner & 2 else -width / 2)
        c, s = math.cos(car.heading_rad), math.sin(car.heading_rad)
        n = car.north_m - vehicle.north_m + along * c - across * s
        e = car.east_m - vehicle.east_m + along * s + across * c
        d = vehicle.height_m - (height if corner & 4 else 0.0)
        c, s = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
        forward, right = n * c + e * s, e * c - n * s
        c, s = math.cos(vehicle.pitch_rad), math.sin(vehicle.pitch_rad)
        forward, down = forward * c - d * s, forward * s + d * c
        c, s = math.cos(vehicle.roll_rad), math.sin(vehicle.roll_rad)
        right, down = right * c + down * s, down * c - right * s
        c, s = math.cos(MOUNT_PITCH_RAD), math.sin(MOUNT_PITCH_RAD)
        forward, down = forward * c - down * s, forward * s + down * c
        if forward < 0.5:
            return None
        us.append(320 + FOCAL_PX * right / forward)
        vs.append(240 + FOCAL_PX * down / forward)
    left, right_px, top, bottom = (edge + rng.gauss(0, noise_px) for edge in (min(us), max(us), min(vs), max(vs)))
    if not (0 < (left + right_px) / 2 < 640 and 0 < (top + bottom) / 2 < 480):
        return None
    return Box((left + right_px) / 2, (top + bottom) / 2, max(right_px - left, 3.0), max(bottom - top, 3.0))


def car_at(t_s: float, flight: Flight) -> Car:
    """Standing until _DRIVE_S, then gaining 1 m/s every second up to its speed."""
    north_m = START_M + _driven_m(min(t_s, flight.circle_from_s), flight.speed_mps)
    turned_rad = (START_M + _driven_m(t_s, flight.speed_mps) - north_m) / flight.radius_m
    east_m = flight.radius_m * (1 - math.cos(turned_rad))
    return Car(north_m + flight.radius_m * math.sin(turned_rad), east_m, turned_rad)


def _driven_m(t_s: float, speed_mps: float) -> float:
    driven_s = max(t_s - _DRIVE_S, 0.0)
    ramp_s = min(driven_s, speed_mps)
    return ramp_s**2 / 2 + speed_mps * (driven_s - ramp_s)


def fly(flight: Flight) -> Outcome:
    """From the selection to the end, and what became of the distance."""
    rng = random.Random(flight.seed)
    vehicle, attitude = Vehicle(height_m=HEIGHT_M), AttitudeBuffer()
    control = FollowControl(flight.config, CAMERA, attitude)
    control.wanted = Wanted(standoff_m=flight.standoff_m)
    telemetry: deque[tuple[float, VehicleState]] = deque()
    frames: deque[tuple[float, Box | None]] = deque()
    state, mode, command = VehicleState(), VehicleMode.HOLD, ((0.0, 0.0, 0.0), 0.0)
    rows: list[Row] = []
    for step in range(round(flight.duration_s / DT_S)):
        now = 1.0 + step * DT_S
        vehicle.step(*command)
        car = car_at(now, flight)
        if step % 2 == 0:
            telemetry.append((now + 0.03, replace(telemetry_of(vehicle, now), mode=mode, battery_frac=1.0)))
        while telemetry and telemetry[0][0] <= now + 1e-9:
            _, state = telemetry.popleft()
            stamp = state.attitude_t_s or 0.0
            attitude.add(stamp, state.roll_rad, state.pitch_rad, state.yaw_rad)
        if step % 5 == 1:
            box = car_box(vehicle, car, rng, flight.noise_px)
            if box is not None and flight.cover is not None:
                box = flight.cover.cut(box, now)
            frames.append((now, box))
        while frames and frames[0][0] + flight.delay_s <= now + 1e-9:
            captured, box = frames.popleft()
            result = TrackResult(box, 1.0, 0.9) if box is not None else None
            control.saw(Seen(Frame(step, _BLANK, captured, now), 1 if now > 2.0 else 0, result, now), now)
        if step % 5 == 0:
            if step == 100:
                control.select(1)
            if step == round(_CONFIRM_S / DT_S):
                control.act(Act.CONFIRM)
            tick = control.tick(now, state)
            mode = VehicleMode.EXTERNAL if tick.output.engaging else mode
            mode = VehicleMode.HOLD if tick.output.state is State.RELEASED else mode
            command = ((0.0, 0.0, 0.0), 0.0)
            if tick.setpoint is not None and mode is VehicleMode.EXTERNAL:
                command = tick.setpoint.velocity_ned_mps, tick.setpoint.yaw_rate_rps
            gap = car.north_m - vehicle.north_m, car.east_m - vehicle.east_m
            bearing = math.remainder(math.atan2(gap[1], gap[0]) - vehicle.yaw_rad, 2 * math.pi)
            rows.append(
                Row(
                    now, math.hypot(*gap), math.degrees(bearing), math.hypot(vehicle.vn.value, vehicle.ve.value),
                    tick.output.state, tick.target, tick.inputs.rejections_in_a_row,
                )
            )  # fmt: skip
    return _judge(rows, flight)


def _judge(rows: list[Row], flight: Flight) -> Outcome:
    cover = flight.cover or Cover()
    before = [row.distance_m for row in rows if cover.from_s - 2.0 <= row.t_s < cover.from_s]
    level_m = sum(before) / len(before)
    after = [row for row in rows if row.t_s >= cover.from_s]
    errors = [row.distance_m / level_m - 1 for row in after]
    worst = max(range(len(errors)), key=lambda at: abs(errors[at]))
    back = (row.t_s for row, error in zip(after[worst:], errors[worst:], strict=True) if abs(error) <= 0.10)
    return Outcome(
        rows=rows,
        peak_frac=errors[worst],
        recovery_s=max(next(back, math.inf) - cover.until_s, 0.0),
        lowest_frac=min(errors),
        most_rejections=max(row.rejections for row in after),
        bearing_peak_deg=max(abs(row.bearing_deg) for row in after),
        fastest_mps=max(row.speed_mps for row in after),
        end_state=rows[-1].state,
    )
