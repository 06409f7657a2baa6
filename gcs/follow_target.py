"""Publishes the target for the vehicle's own follow mode (FOLLOW_TARGET): PX4's Follow-Me, ArduCopter's Follow.

Both carry a target on with its last velocity for 3 s after it was last published (read in their sources). So what is
not seen any more is not left unpublished: it is said to slow down and to stand still, until the vehicle holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from control.camera import CameraModel
from control.checks import fresh
from control.engagement import Action, State
from control.gate import Limits, Setpoint
from control.geolocation import Aim, moved_deg, offset_from_m, target_fix
from control.types import Reason
from gcs.audit_follow_mode import OwnPlace, own_place
from gcs.codec import PublishedTarget
from gcs.home_frame import VehiclePlace
from gcs.telemetry import Telemetry
from gcs.tick import Tick
from gcs.wire import Wire

PERIOD_S: Final = 0.1
_EARLY_S: Final = 0.01  # ticks are not exact
_PASSED: Final = frozenset({Reason.PASSED, Reason.SPEED, Reason.ALTITUDE, Reason.FENCE, Reason.SLEW})
_FLAT_M: Final = 2000.0  # so far the earth is


class FollowTargetOutput:
    """What is published moves no faster than `limits` let the vehicle fly, whatever is seen."""

    steers = False
    decides = "distance, height and side are the vehicle's own follow mode's: its parameters say them (`gcs audit`)"

    def __init__(self, wire: Wire, telemetry: Telemetry, camera: CameraModel, limits: Limits) -> None:
        self._wire = wire
        self._telemetry = telemetry
        self._camera = camera
        self._limits = limits
        self._origin: VehiclePlace | None = None  # where the vehicle was when the follow began
        self._aim: Aim | None = None
        self._sent_t_s = -math.inf
        self._stands = False  # as last published
        self._own_place: OwnPlace | None = None

    @property
    def problem(self) -> str:
        """Without the vehicle's place on the earth the target has none."""
        return "" if self._telemetry.place is not None else "the vehicle has not told its latitude and longitude yet"

    @property
    def label(self) -> str:
        """Who flies, and where it keeps itself."""
        return "follow-target" if self._own_place is None else f"follow-target: {self._own_place.text}"

    def audited(self, values: Mapping[str, float]) -> str:
        """Where the vehicle will fly, and whether the camera can see the target from there."""
        place = self._own_place = own_place(self._telemetry.vehicle.autopilot.name, values)
        said = f"its own follow mode will keep the vehicle {place.text}"
        if place.distance_m is None or place.height_m is None:
            return said
        down_rad = math.atan2(place.height_m, max(place.distance_m, 0.1))
        if abs(self._camera.mount_rpy_rad[1] + down_rad) < self._camera.vfov_rad / 2:
            return said
        below_deg = math.degrees(down_rad)
        return f"{said}: the target is then {below_deg:.0f} degrees below the horizon, out of a fixed camera's view"

    def send(self, tick: Tick) -> None:
        """The target as seen, slowing down, or standing still; nothing without a setpoint of the gate."""
        if tick.setpoint is None or tick.output.action is Action.ENGAGE:
            self._origin = self._aim = None
            return
        self._aim = self._next(tick)
        self._publish(tick.setpoint)

    def stop(self, setpoint: Setpoint) -> None:
        """It stands still from now on."""
        if self._aim is not None:
            self._aim = self._aim.fading(setpoint.t_s, 0.0)
        self._publish(setpoint)

    def _next(self, tick: Tick) -> Aim | None:
        passed = tick.gate in _PASSED and tick.output.action is Action.SEND_REQUEST
        if passed and tick.output.state is State.FOLLOWING and (aim := self._seen(tick)) is not None:
            return aim
        coasting = passed and tick.output.state is State.COASTING
        return self._aim and self._aim.fading(tick.t_s, tick.output.velocity_factor if coasting else 0.0)

    def _seen(self, tick: Tick) -> Aim | None:
        """None where its place cannot be told."""
        place, limits = self._telemetry.place, self._limits
        target, motion = tick.target, tick.motion
        if target is None or motion is None or place is None:
            return None
        fix = target_fix(target, motion.distance_m, motion.radial_mps, motion.tangential_mps)
        if fix is None or not fresh(place.t_s, tick.t_s, limits.telemetry_age_s):
            return None
        origin = self._origin = self._origin or place
        at = (*offset_from_m(place.deg, origin.deg), origin.altitude_m - place.altitude_m)
        carried_s = fix.t_s - place.t_s  # the vehicle has flown on since
        north, east, down = (
            metres + speed * carried_s + offset
            for metres, speed, offset in zip(at, tick.inputs.vehicle.velocity_ned_mps, fix.offset_ned_m, strict=True)
        )
        if math.hypot(north, east, down) > _FLAT_M:
            return None
        place_m, most_mps = (north, east, down), limits.max_speed_mps
        if self._aim is None:
            return Aim.begin(tick.t_s, place_m, fix.velocity_ned_mps, fix.std_ned_m, most_mps)
        return self._aim.seen(tick.t_s, place_m, fix.std_ned_m, most_mps)

    def _publish(self, setpoint: Setpoint) -> None:
        """Ten times a second, and at once when it stops."""
        aim, origin = self._aim, self._origin
        if aim is None or origin is None:
            return
        stands = aim.velocity_ned_mps == (0.0, 0.0, 0.0)
        if setpoint.t_s - self._sent_t_s < PERIOD_S - _EARLY_S and (self._stands or not stands):
            return
        north, east, down = aim.position_ned_m
        latitude_deg, longitude_deg = moved_deg(origin.deg, (north, east))
        target = PublishedTarget(
            latitude_deg, longitude_deg, origin.altitude_m - down, aim.velocity_ned_mps, aim.std_ned_m
        )
        if self._wire.send_setpoint(setpoint, target):
            self._sent_t_s, self._stands = setpoint.t_s, stands
