"""Which way: every sign from the picture to the wire, against school trigonometry that shares no code with control/.

The camera looks forward and 28 degrees down. A target right of the nose is right in the picture (u grows), one
further away is higher in it (v falls); a vehicle that leans right sees the horizon turn anticlockwise.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from control.camera import bearing_measurement
from control.gate import Setpoint
from control.types import Vec3, VehicleState
from gcs import codec
from gcs.autopilot.px4 import Px4
from gcs.codec import VehicleId
from tests.gcs import flight_rig
from tests.gcs.flight_rig import AIRBORNE, CAMERA, Rig
from tracker.box import Box

HEADINGS_DEG = [-180.0, -120.0, -45.0, 0.0, 30.0, 90.0, 179.0]
DOWN_RAD = math.radians(28.0)  # of the camera
SIDE_M = 1.6


def ahead(vehicle: VehicleState, forward_m: float, right_m: float, down_m: float = 9.0) -> Vec3:
    """The place so far before the nose, to its right and below it, NED."""
    c, s = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
    north, east, down = vehicle.position_ned_m
    return north + forward_m * c - right_m * s, east + forward_m * s + right_m * c, down + down_m


def seen_box(target_ned_m: Vec3, vehicle: VehicleState) -> Box:
    """The cube's box: turned into the nose's frame by yaw, tilted by pitch and the mount, then turned by roll."""
    north, east, down = (t - v for t, v in zip(target_ned_m, vehicle.position_ned_m, strict=True))
    bearing_rad = math.atan2(east, north) - vehicle.yaw_rad
    level_m = math.hypot(north, east)
    forward, right = level_m * math.cos(bearing_rad), level_m * math.sin(bearing_rad)
    below_rad = math.atan2(down, forward) + vehicle.pitch_rad  # below the body's nose
    reach_m = math.hypot(forward, down)
    forward, down = reach_m * math.cos(below_rad), reach_m * math.sin(below_rad)
    right, down = (
        right * math.cos(vehicle.roll_rad) + down * math.sin(vehicle.roll_rad),
        down * math.cos(vehicle.roll_rad) - right * math.sin(vehicle.roll_rad),
    )
    below_rad, reach_m = math.atan2(down, forward) - DOWN_RAD, math.hypot(forward, down)
    depth_m, low_m = reach_m * math.cos(below_rad), reach_m * math.sin(below_rad)
    focal_px = 320.0 / math.tan(math.radians(35.0))
    side_px = focal_px * SIDE_M / depth_m
    return Box(320.0 + focal_px * right / depth_m, 240.0 + focal_px * low_m / depth_m, side_px, side_px)


@pytest.fixture
def rig_at(monkeypatch: pytest.MonkeyPatch):
    """A follow under way of a target 15 m straight ahead, the vehicle heading so (deg), leaning so."""

    def begin(heading_deg: float, roll_deg: float = 0.0, pitch_deg: float = 0.0) -> Rig:
        angles = (math.radians(a) for a in (heading_deg, roll_deg, pitch_deg))
        yaw_rad, roll_rad, pitch_rad = angles
        vehicle = replace(AIRBORNE, yaw_rad=yaw_rad, roll_rad=roll_rad, pitch_rad=pitch_rad)
        rig = Rig(vehicle=vehicle, target_ned_m=ahead(vehicle, 15.0, 0.0))
        monkeypatch.setattr(flight_rig, "box_of", lambda target, *_: seen_box(target, rig.vehicle))
        rig.follow()
        rig.run(1.0)
        return rig

    return begin


def sent(rig: Rig, seconds: float = 1.0) -> Setpoint:
    """The setpoint that leaves so much later."""
    setpoint = rig.run(seconds)[-1].setpoint
    assert setpoint is not None
    return setpoint


def along(setpoint: Setpoint, vehicle: VehicleState) -> tuple[float, float]:
    """(forward, right) of the velocity as the nose sees it, m/s."""
    north, east, _ = setpoint.velocity_ned_mps
    c, s = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
    return north * c + east * s, east * c - north * s


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
@pytest.mark.parametrize("right_m", [4.0, -4.0])
def test_a_target_to_the_right_yaws_right(rig_at, heading_deg: float, right_m: float) -> None:
    rig = rig_at(heading_deg)
    assert abs(sent(rig).yaw_rate_rps) < 0.02
    rig.target_ned_m = ahead(rig.vehicle, 15.0, right_m)
    assert math.copysign(1.0, right_m) * (seen_box(rig.target_ned_m, rig.vehicle).cx_px - 320.0) > 50.0
    assert math.copysign(1.0, right_m) * sent(rig, 2.0).yaw_rate_rps > 0.2


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
@pytest.mark.parametrize("forward_m", [19.0, 11.0])
def test_a_target_further_away_is_flown_to_and_a_nearer_one_backed_off_from(
    rig_at, heading_deg: float, forward_m: float
) -> None:
    rig = rig_at(heading_deg)
    rig.target_ned_m = ahead(rig.vehicle, forward_m, 0.0)
    forward_mps, right_mps = along(sent(rig, 2.5), rig.vehicle)
    assert math.copysign(1.0, forward_m - 15.0) * forward_mps > 0.3
    assert abs(right_mps) < 0.1 * abs(forward_mps)


@pytest.mark.parametrize("heading_deg", HEADINGS_DEG)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_target_that_walks_to_the_right_is_moved_along_with(rig_at, heading_deg: float, side: float) -> None:
    rig = rig_at(heading_deg)
    rig.target_ned_m = ahead(rig.vehicle, 15.0, 8.0 * side)
    forward_mps, right_mps = along(sent(rig, 1.5), rig.vehicle)
    assert side * right_mps > 0.5
    assert abs(forward_mps) < abs(right_mps)


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(20.0, 0.0), (-20.0, 0.0), (0.0, 8.0), (0.0, -8.0), (15.0, -6.0)])
def test_a_vehicle_that_leans_sees_the_target_where_it_is(rig_at, roll_deg: float, pitch_deg: float) -> None:
    """The picture swings by up to a hundred pixels; the line of sight does not."""
    rig = rig_at(40.0, roll_deg, pitch_deg)
    off_px = seen_box(rig.true_target, rig.vehicle).cx_px - 320.0
    assert abs(off_px) > 10.0 or roll_deg == 0.0
    target = rig.ticks[-1].target
    assert target is not None
    assert target.azimuth_rad == pytest.approx(math.radians(40.0), abs=1e-3)
    assert target.elevation_rad == pytest.approx(-math.atan2(9.0, 15.0), abs=1e-3)
    assert abs(sent(rig).yaw_rate_rps) < 0.02


@pytest.mark.parametrize("sunk_m", [2.0, -2.0])
def test_a_vehicle_below_its_height_climbs(rig_at, sunk_m: float) -> None:
    rig = rig_at(0.0)
    height_m = 9.0 - sunk_m
    rig.vehicle = replace(rig.vehicle, position_ned_m=(0.0, 0.0, -height_m), height_m=height_m)
    assert math.copysign(1.0, sunk_m) * sent(rig).velocity_ned_mps[2] < -0.3  # down is positive


def test_the_wire_carries_north_east_down_and_clockwise(rig_at) -> None:
    """SET_POSITION_TARGET_LOCAL_NED as any autopilot reads it: MAV_FRAME_LOCAL_NED, m/s, rad/s."""
    rig = rig_at(0.0)
    rig.target_ned_m = ahead(rig.vehicle, 19.0, 6.0)
    setpoint = sent(rig, 2.5)
    message = codec.setpoint(setpoint, VehicleId(1, 1, Px4()), 1000)
    decoded = mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 255, 190))))
    assert decoded.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    assert decoded.vx > 0.3
    assert decoded.vy > 0.3
    assert decoded.yaw_rate > 0.1


def test_the_trigonometry_of_this_file_agrees_with_the_camera() -> None:
    """So that a sign that is wrong in both would have to be wrong in two ways of writing it."""
    vehicle = replace(AIRBORNE, yaw_rad=0.6, roll_rad=-0.2, pitch_rad=0.1)
    box = seen_box(ahead(vehicle, 14.0, 3.0), vehicle)
    numbers = (box.cx_px, box.cy_px, box.w_px, box.h_px)
    attitude = (vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad)
    measured = bearing_measurement(CAMERA, *numbers, attitude, 1.0, 0.9)
    assert measured.azimuth_rad == pytest.approx(0.6 + math.atan2(3.0, 14.0), abs=1e-9)
    assert measured.elevation_rad == pytest.approx(-math.atan2(9.0, math.hypot(14.0, 3.0)), abs=1e-9)
