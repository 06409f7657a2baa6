"""A flight without any I/O: a vehicle that is told its state, a target at a known place, a fake clock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from control.attitude import AttitudeBuffer
from control.camera import CameraModel, project
from control.config import ControlConfig
from control.gate import TICK_S
from control.types import Vec3, VehicleMode, VehicleState
from gcs.flight_control import Act, FollowControl, Tick
from gcs.flight_vision import Seen
from gcs.link_health import LinkHealth
from gcs.video import Frame
from tracker.box import Box, TrackResult

CAMERA = CameraModel.from_hfov(640, 480, math.radians(70), mount_rpy_rad=(0.0, math.radians(-28), 0.0))
BLANK = np.zeros((480, 640, 3), np.uint8)
DELAY_S = 0.1
_SIDE_M = 1.6
AIRBORNE = VehicleState(
    mode=VehicleMode.HOLD,
    armed=True,
    in_air=True,
    position_ned_m=(0.0, 0.0, -9.0),
    height_m=9.0,
    battery_frac=1.0,
)


def box_of(
    target_ned_m: Vec3, vehicle_ned_m: Vec3, yaw_rad: float, roll_rad: float = 0.0, pitch_rad: float = 0.0
) -> Box | None:
    """The box of a cube as the rig's camera sees it."""
    direction = np.array(target_ned_m) - np.array(vehicle_ned_m)
    centre = project(CAMERA, direction, roll_rad, pitch_rad, yaw_rad)
    if centre is None:
        return None
    side_px = _SIDE_M / float(np.linalg.norm(direction)) * CAMERA.focal_px
    return Box(*centre, side_px, side_px)


@dataclass
class Rig:
    """Advance with `run`; look at `ticks`. Every field may be changed on the way."""

    now_s: float = 100.0
    vehicle: VehicleState = AIRBORNE
    target_ned_m: Vec3 = (16.0, 1.0, 0.0)
    config: ControlConfig = field(default_factory=ControlConfig)
    sees: bool = True  # the tracker gives a box
    video: bool = True  # frames come
    frozen: bool = False
    telemetry: bool = True
    confidence: float = 0.9
    delay_s: float = DELAY_S  # from the picture to its result
    link: LinkHealth | None = None
    speed_mps: float = 3.0  # at which the target walks to where target_ned_m says
    ticks: list[Tick] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.attitude = AttitudeBuffer()
        self.control = FollowControl(self.config, CAMERA, self.attitude)
        self._number = 0
        self._stamped = self.vehicle
        self._target = self.target_ned_m

    def select(self) -> None:
        self._number += 1
        self.control.select(self._number)

    def run(self, seconds: float, act: Act | None = None) -> list[Tick]:
        """Ticks of this long; act: before the first. Returns them."""
        if act is not None:
            self.control.act(act)
        count = round(seconds / TICK_S)
        for _ in range(count):
            self.now_s += TICK_S
            self._walk()
            self._hear()
            if self.video:
                self._see()
            self.ticks.append(self.control.tick(self.now_s, self._stamped, self.link))
        return self.ticks[-count:]

    @property
    def true_target(self) -> Vec3:
        """Where the target is now, NED."""
        return self._target

    def place(self, target_ned_m: Vec3) -> None:
        """The target is there at once."""
        self._target = self.target_ned_m = target_ned_m

    def stall(self, seconds: float) -> None:
        """Our own program stands still; the world goes on."""
        self.now_s += seconds

    def _walk(self) -> None:
        way = np.array(self.target_ned_m) - np.array(self._target)
        length_m = float(np.linalg.norm(way))
        step = min(1.0, self.speed_mps * TICK_S / length_m) if length_m > 0 else 0.0
        north, east, down = np.array(self._target) + step * way
        self._target = (float(north), float(east), float(down))

    def _hear(self) -> None:
        t_s = self.now_s - 0.01
        if not self.telemetry:
            return
        self._stamped = replace(self.vehicle, heartbeat_t_s=t_s, mode_t_s=t_s, attitude_t_s=t_s, position_t_s=t_s)
        for ahead_s in (-0.03, 0.0):
            self.attitude.add(t_s + ahead_s, self.vehicle.roll_rad, self.vehicle.pitch_rad, self.vehicle.yaw_rad)

    def _see(self) -> None:
        t_s = self.now_s - 0.02
        frame = Frame(len(self.ticks), BLANK, t_s - self.delay_s, t_s)
        box = box_of(self._target, self.vehicle.position_ned_m, self.vehicle.yaw_rad)
        sees = self.sees and self._number > 0 and box is not None and not self.frozen
        result = TrackResult(box, 1.0, self.confidence) if sees and box is not None else None
        self.control.saw(Seen(frame, self._number, result, self.now_s, frozen=self.frozen), self.now_s)

    def follow(self) -> None:
        """Select, confirm, and let the vehicle obey."""
        self.run(3.0)  # the attitude rate is known
        self.select()
        self.run(1.0)
        self.run(0.1, Act.CONFIRM)
        assert self.ticks[-1].output.engaging, self.ticks[-1].output
        self.vehicle = replace(self.vehicle, mode=VehicleMode.EXTERNAL)
        self.run(0.2)


def still(tick: Tick) -> bool:
    """A zero setpoint."""
    setpoint = tick.setpoint
    return setpoint is not None and (*setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) == (0.0, 0.0, 0.0, 0.0)


def moving(tick: Tick) -> bool:
    """A setpoint that is not zero."""
    return tick.setpoint is not None and not still(tick)
