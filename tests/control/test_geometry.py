"""Camera geometry and attitude, held against formulas that do not come from the code under test."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.attitude import AttitudeBuffer, wrap_pi
from control.camera import (
    CameraModel,
    bearing_measurement,
    box_of,
    direction_ned,
    line_of_sight_ned,
    project,
    ray_camera,
)
from control.types import TargetState

LEVEL = (0.0, 0.0, 0.0)
CAMERA = CameraModel.from_hfov(640, 480, math.radians(90))  # focal length 320 px
LENS = replace(CameraModel.from_hfov(640, 480, math.radians(70)), distortion=(-0.28, 0.07, 0.0005, -0.0003, 0.01))


def measure(camera=CAMERA, u=320.0, v=240.0, w=32.0, h=32.0, attitude=LEVEL):
    return bearing_measurement(camera, u, v, w, h, attitude, 1.0, 0.9)


def test_the_middle_pixel_looks_where_the_nose_points():
    assert line_of_sight_ned(CAMERA, 320, 240, 0, 0, 0) == pytest.approx([1, 0, 0])
    assert line_of_sight_ned(CAMERA, 320, 240, 0, 0, math.pi / 2) == pytest.approx([0, 1, 0], abs=1e-12)
    assert line_of_sight_ned(CAMERA, 320, 240, 0, math.radians(-30), 0)[2] == pytest.approx(0.5)


def test_right_in_the_picture_is_clockwise_and_up_is_above():
    assert measure(u=640).azimuth_rad == pytest.approx(math.radians(45))
    assert measure(u=0).azimuth_rad == pytest.approx(math.radians(-45))
    assert measure(v=0).elevation_rad == pytest.approx(math.atan2(240, 320))
    assert measure(v=480).elevation_rad == pytest.approx(-math.atan2(240, 320))
    assert measure(u=640, attitude=(0, 0, math.radians(170))).azimuth_rad == pytest.approx(math.radians(-145))


def test_nose_up_raises_and_roll_right_turns_the_picture():
    assert measure(attitude=(0, math.radians(10), 0)).elevation_rad == pytest.approx(math.radians(10))
    # Rolled right by 90 degrees the picture's right edge is below.
    assert measure(u=640, attitude=(math.pi / 2, 0, 0)).elevation_rad == pytest.approx(math.radians(-45))


def test_a_mount_that_looks_down_and_right():
    down = replace(CAMERA, mount_rpy_rad=(0.0, math.radians(-25), 0.0))
    assert measure(down).elevation_rad == pytest.approx(math.radians(-25))
    assert measure(down, attitude=(0, math.radians(25), 0)).elevation_rad == pytest.approx(0, abs=1e-12)
    right = replace(CAMERA, mount_rpy_rad=(0.0, 0.0, math.radians(40)))
    assert measure(right).azimuth_rad == pytest.approx(math.radians(40))


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 2.5])
def test_a_point_on_the_ground_by_plain_trigonometry(yaw):
    """A target 12 m ahead and 5 m to the right of a vehicle 6 m up."""
    u, v = 320 + 320 * 5 / 12, 240 + 320 * 6 / 12
    seen = measure(u=u, v=v, attitude=(0, 0, yaw))
    assert wrap_pi(seen.azimuth_rad - yaw) == pytest.approx(math.atan2(5, 12))
    assert seen.elevation_rad == pytest.approx(-math.atan2(6, 13))


def test_size_is_the_object_over_its_range_wherever_in_the_picture():
    """An upright square of 2 m at 20 m depth: 32 px, in the middle or at the edge."""
    assert measure().log_size == pytest.approx(math.log(2 / 20))
    edge_range = math.hypot(20, 20)
    assert measure(u=640).log_size == pytest.approx(math.log(2 / edge_range))


def test_distortion_is_undone_to_a_thousandth_of_a_pixel():
    for u, v in ((5.0, 5.0), (320.0, 240.0), (630.0, 100.0), (100.0, 470.0)):
        ray = ray_camera(LENS, u, v)
        k1, k2, p1, p2, k3 = LENS.distortion
        x, y = ray[0] / ray[2], ray[1] / ray[2]
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        assert (LENS.fx_px * xd + 320, LENS.fy_px * yd + 240) == pytest.approx((u, v), abs=1e-3)


def test_a_lens_without_an_inverse_still_gives_a_direction():
    fold = replace(CAMERA, distortion=(5.0, 0.0, 0.0, 0.0, 0.0))
    assert np.linalg.norm(ray_camera(fold, 0.0, 0.0)) == pytest.approx(1.0)


angle = st.floats(-3.1, 3.1)
tilt = st.floats(-0.6, 0.6)


@settings(max_examples=200, deadline=None)
@given(st.floats(20, 620), st.floats(20, 460), tilt, tilt, angle, tilt, tilt, angle)
def test_projecting_a_line_of_sight_gives_its_pixel_back(u, v, roll, pitch, yaw, mount_r, mount_p, mount_y):
    camera = replace(LENS, mount_rpy_rad=(mount_r, mount_p, mount_y))
    sight = line_of_sight_ned(camera, u, v, roll, pitch, yaw)
    assert np.linalg.norm(sight) == pytest.approx(1)
    assert project(camera, sight, roll, pitch, yaw) == pytest.approx((u, v), abs=2e-3)


def test_behind_the_camera_there_is_no_pixel():
    assert project(CAMERA, np.array([-1.0, 0.1, 0.0]), *LEVEL) is None
    assert project(CAMERA, np.array([0.0, 1.0, 0.0]), *LEVEL) is None
    assert project(CAMERA, np.array([math.nan, 0.0, 0.0]), *LEVEL) is None


def state(azimuth=0.2, elevation=-0.3, log_size=-2.5):
    return TargetState(
        t_s=0, azimuth_rad=azimuth, azimuth_rate_rps=0, elevation_rad=elevation, elevation_rate_rps=0,
        log_size=log_size, log_size_rate_ps=0, azimuth_std_rad=0, azimuth_rate_std_rps=0, log_size_std=0,
        confidence=1, measured_t_s=0, rejections_in_a_row=0,
    )  # fmt: skip


def test_box_of_is_the_measurement_turned_round():
    attitude = (0.1, -0.2, 0.15)
    cx, cy, w, h = box_of(LENS, state(), attitude, aspect=0.5)
    assert w / h == pytest.approx(0.5)
    again = bearing_measurement(LENS, cx, cy, w, h, attitude, 0, 1)
    values = (again.azimuth_rad, again.elevation_rad, again.log_size)
    assert values == pytest.approx((0.2, -0.3, -2.5), abs=1e-5)
    assert box_of(LENS, state(azimuth=math.pi), attitude) is None
    assert box_of(LENS, state(), attitude, aspect=0.0) is None


def test_direction_is_unit_north_east_down():
    assert direction_ned(math.pi / 2, 0) == pytest.approx([0, 1, 0], abs=1e-12)
    assert direction_ned(0, math.pi / 2) == pytest.approx([0, 0, -1], abs=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx_px": 0.0}, "fx_px must be positive"),
        ({"width_px": -1}, "width_px must be positive"),
        ({"cy_px": math.nan}, "cy_px must be finite"),
        ({"distortion": (0.0, 0.0)}, "distortion must be five"),
        ({"mount_rpy_rad": (0.0, math.inf, 0.0)}, "mount_rpy_rad must be finite"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(CAMERA, **change)
    with pytest.raises(ValueError, match="hfov_rad"):
        CameraModel.from_hfov(640, 480, math.pi)


@pytest.mark.parametrize("bad", [{"w": 0.0}, {"h": -1.0}, {"u": math.nan}, {"w": math.inf}])
def test_a_box_that_cannot_be_is_refused(bad):
    with pytest.raises(ValueError, match="not a usable box"):
        measure(**bad)


def test_vertical_field_of_view():
    assert CAMERA.vfov_rad == pytest.approx(2 * math.atan(240 / 320))


def test_attitude_is_interpolated_the_short_way_round():
    buffer = AttitudeBuffer()
    buffer.add(1.0, 0.0, 0.1, math.radians(170))
    buffer.add(1.2, 0.2, -0.1, math.radians(-170))
    roll, pitch, yaw = buffer.at(1.1)
    assert (roll, pitch) == pytest.approx((0.1, 0.0))
    assert abs(yaw) == pytest.approx(math.pi)
    assert buffer.at(1.0) == pytest.approx((0.0, 0.1, math.radians(170)))
    assert buffer.at(1.2) == pytest.approx((0.2, -0.1, math.radians(-170)))


def test_attitude_is_unknown_outside_the_buffer_and_inside_a_gap():
    buffer = AttitudeBuffer(max_ahead_s=0.1, max_gap_s=0.5)
    assert buffer.at(1.0) is None
    assert buffer.newest_t_s is None
    buffer.add(1.0, 0, 0, 0)
    buffer.add(2.0, 0, 0, 1)
    assert buffer.at(0.9) is None
    assert buffer.at(1.5) is None
    assert buffer.at(1.0) == (0, 0, 0)
    assert buffer.at(2.05) == (0, 0, 1)  # too long a gap to take a rate from
    assert buffer.at(2.11) is None
    assert buffer.at(math.nan) is None
    assert buffer.newest_t_s == 2.0


def test_attitude_goes_on_at_its_rate_for_a_moment():
    buffer = AttitudeBuffer()
    for n in range(11):
        buffer.add(n * 0.02, 0, 0, n * 0.01)
    assert buffer.at(0.26)[2] == pytest.approx(0.13)
    single = AttitudeBuffer()
    single.add(1.0, 0.1, 0.2, 0.3)
    single.add(1.0001, 0.1, 0.2, 0.4)  # two of one burst: no rate from these
    assert single.at(1.05) == (0.1, 0.2, 0.4)


def test_attitude_sorts_refuses_and_forgets():
    buffer = AttitudeBuffer(capacity=3)
    assert buffer.add(1.2, 0, 0, 0.2)
    assert buffer.add(1.0, 0, 0, 0.0)
    assert buffer.at(1.1) == pytest.approx((0, 0, 0.1))
    assert not buffer.add(1.0, 0, 0, 9.0)
    assert not buffer.add(1.3, math.nan, 0, 0)
    assert not buffer.add(math.inf, 0, 0, 0)
    buffer.add(1.4, 0, 0, 0.4)
    buffer.add(1.6, 0, 0, 0.6)
    assert buffer.at(1.1) is None
    assert buffer.rate_hz(1.6, window_s=0.5) == pytest.approx(6)
    with pytest.raises(ValueError, match="capacity"):
        AttitudeBuffer(capacity=1)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_are_the_same_direction(a):
    assert -math.pi < wrap_pi(a) <= math.pi
    assert math.cos(wrap_pi(a)) == pytest.approx(math.cos(a), abs=1e-9)
