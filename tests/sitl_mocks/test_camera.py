"""The rendered camera against geometry worked out another way."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import cv2
import numpy as np
import pytest

from sitl_mocks.camera import Rendered, RenderedCamera, Sensor, Truth, visible_box
from sitl_mocks.lens import Lens
from sitl_mocks.world import Actor, Kind, ObjectState, Path, Pose, Segment, SpeedProfile, World

_CLEAN = Sensor(noise_std=0.0, blur_px=0.0, vignette_frac=0.0)
_SIZE = (4.0, 2.0, 1.5)
_RED, _GREY = (20, 20, 220), (150, 150, 150)


def _actor(kind: Kind, start: Pose, speed_mps: float = 0.0, size: tuple[float, float, float] = _SIZE) -> Actor:
    return Actor("target", kind, size, _RED, Path(start, (Segment(500.0),), 500.0), SpeedProfile(((0.0, speed_mps),)))


def _prop(name: str, kind: Kind, position: tuple[float, float, float], size: tuple[float, float, float]) -> ObjectState:
    return ObjectState(name, kind, position, (0.0, 0.0, 0.0), 0.0, size, _GREY)


@cache
def _block_camera(distorted: bool = False) -> RenderedCamera:
    lens = Lens(distortion=(-0.12, 0.02, 0.001, -0.0005, 0.0)) if distorted else Lens()
    world = World(3, (_actor(Kind.BLOCK, Pose(20.0, 2.0, 0.5)),), (), ())
    return RenderedCamera(world, lens, _CLEAN)


@cache
def _moving_camera() -> RenderedCamera:
    """A car that drives east, 20 m north; a wall stands between it and home, further east."""
    wall = _prop("wall", Kind.BLOCK, (14.0, 12.0, 0.0), (1.0, 8.0, 4.0))
    car = _actor(Kind.CAR, Pose(20.0, -4.0, math.pi / 2), 4.0, (4.3, 1.8, 1.45))
    return RenderedCamera(World(3, (car,), (wall,), ()))


def _expected_box(camera: RenderedCamera, position: tuple[float, float, float], rpy: tuple[float, float, float]):  # type: ignore[no-untyped-def]
    """All eight corners of the block through OpenCV's own projection, the rotation from Rodrigues vectors."""
    (n, e, _), psi, lens = (20.0, 2.0, 0.0), 0.5, camera.lens
    corners = []
    for x in (-2.0, 2.0):
        for y in (-1.0, 1.0):
            for z in (0.0, 1.5):
                c, s = math.cos(psi), math.sin(psi)
                corners.append((n + x * c - y * s, e + x * s + y * c, -z))
    roll, pitch, yaw = rpy
    turn = np.eye(3)
    for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll), ((0, 1, 0), lens.mount_pitch_rad)):
        turn = turn @ cv2.Rodrigues(np.array(axis, float) * angle)[0]
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
    rotation = axes @ turn.T
    vector = cv2.Rodrigues(rotation)[0]
    shift = -rotation @ np.array(position)
    f = 320 / math.tan(math.radians(35))
    matrix = np.array([[f, 0, 320], [0, f, 240], [0, 0, 1]])
    points = cv2.projectPoints(np.array(corners), vector, shift, matrix, np.array(lens.distortion))[0].reshape(-1, 2)
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return x0, y0, x1 - x0, y1 - y0


@pytest.mark.parametrize("distorted", [False, True])
@pytest.mark.parametrize(
    ("position", "rpy"),
    [
        ((0.0, 0.0, -9.0), (0.0, 0.0, 0.0)),
        ((3.0, -4.0, -6.0), (0.15, -0.1, 0.3)),
        ((20.0, 25.0, -12.0), (-0.2, 0.05, -math.pi / 2)),
        ((38.0, 10.0, -9.0), (0.05, 0.1, -2.7)),
    ],
)
def test_the_truth_box_is_that_of_the_projected_corners(
    position: tuple[float, float, float], rpy: tuple[float, float, float], distorted: bool
) -> None:
    camera = _block_camera(distorted)
    box = camera.render(0.0, position, *rpy).truth["target"].box_px
    assert box == pytest.approx(_expected_box(camera, position, rpy), abs=0.01)


@pytest.mark.parametrize("distorted", [False, True])
def test_the_painted_object_fills_its_truth_box(distorted: bool) -> None:
    rendered = _block_camera(distorted).render(0.0, (3.0, -4.0, -6.0), 0.15, -0.1, 0.3)
    blue, green, red = (rendered.image_bgr[..., i].astype(int) for i in range(3))
    ys, xs = np.nonzero((red > 60) & (red > 2 * green) & (red > 2 * blue))
    x, y, w, h = rendered.truth["target"].box_px or (0, 0, 0, 0)
    assert (xs.min(), ys.min(), xs.max(), ys.max()) == pytest.approx((x, y, x + w, y + h), abs=2.0)


def test_a_point_on_the_optical_axis_is_in_the_middle() -> None:
    camera = _block_camera()
    view = camera.view((0.0, 0.0, -9.0), 0.0, 0.0, 0.7)
    away = 9.0 / math.tan(math.radians(28))
    point = np.array([[away * math.cos(0.7), away * math.sin(0.7), 0.0]])
    assert view.to_px(view.to_camera(point))[0] == pytest.approx((320.0, 240.0), abs=1e-6)


def test_the_horizon_is_where_the_pitch_puts_it() -> None:
    lens = Lens(mount_pitch_rad=math.radians(-5))
    camera = RenderedCamera(World(3, (_actor(Kind.BLOCK, Pose(-50.0, 0.0, 0.0)),), (), ()), lens, _CLEAN)
    column = camera.render(0.0, (0.0, 0.0, -40.0), 0.0, 0.0, 0.0).image_bgr[:, 320].astype(int)
    row = 240 - lens.focal_px * math.tan(math.radians(5))
    blueness = column[:, 0] - column[:, 2]
    assert blueness[: int(row) - 40].min() > 25  # sky
    assert blueness[int(row) + 60 :].max() < 20  # ground
    assert (np.diff(blueness[: int(row)]) <= 2).all()  # the sky only gets paler towards the horizon


def _car_at(t_s: float) -> Rendered:
    return _moving_camera().render(t_s, (0.0, 0.0, -9.0), 0.0, 0.0, 0.0)


def test_a_target_that_moves_right_moves_right_in_the_picture() -> None:
    boxes = [_car_at(t / 4).truth["target"].box_px for t in range(8)]
    centres = [box[0] + box[2] / 2 for box in boxes if box is not None]
    assert len(centres) == 8
    assert all(b > a + 10 for a, b in pairwise(centres))


def test_turning_right_moves_the_target_left() -> None:
    straight, turned = (
        _moving_camera().render(1.0, (0.0, 0.0, -9.0), 0.0, 0.0, yaw).truth["target"].box_px for yaw in (0.0, 0.1)
    )
    assert straight is not None
    assert turned is not None
    assert turned[0] - straight[0] == pytest.approx(-0.1 * Lens().focal_px, rel=0.15)


def test_a_wall_hides_the_target_and_lets_it_out_again() -> None:
    fracs = [_car_at(t / 2).truth["target"].visible_frac for t in range(22)]
    assert fracs[0] == 1.0
    hidden = fracs.index(min(fracs))
    assert fracs[hidden] < 0.02
    assert all(b <= a + 0.02 for a, b in pairwise(fracs[: hidden + 1]))
    assert any(0.2 < f < 0.8 for f in fracs)
    hidden_box = _car_at(hidden / 2).truth["target"]
    assert hidden_box.box_px is not None  # where it is stays known
    assert visible_box(hidden_box, Lens()) is None


def test_what_leaves_the_frame_counts_as_hidden_by_its_share_outside() -> None:
    camera = _block_camera()
    fracs = []
    for yaw in np.linspace(0.0, 1.0, 21):
        truth = camera.render(0.0, (0.0, 0.0, -9.0), 0.0, 0.0, float(yaw)).truth["target"]
        fracs.append(truth.visible_frac)
        if truth.box_px is not None and truth.visible_frac > 0:
            x, _, w, _ = truth.box_px
            inside = min(x + w, 640) - max(x, 0)
            assert truth.visible_frac == pytest.approx(inside / w, abs=0.2)
    assert fracs[0] == 1.0
    assert fracs[-1] == 0.0
    assert any(0.1 < f < 0.9 for f in fracs)


def test_what_is_behind_has_no_box() -> None:
    truth = _block_camera().render(0.0, (0.0, 0.0, -9.0), 0.0, 0.0, math.pi).truth["target"]
    assert truth == Truth(None, 0.0)


def test_the_same_call_gives_the_same_picture_whatever_came_before() -> None:
    first = _car_at(1.0).image_bgr
    _car_at(2.0)
    assert np.array_equal(first, _car_at(1.0).image_bgr)


def test_the_seed_decides_the_picture() -> None:
    def picture(seed: int) -> np.ndarray:
        world = World(seed, (_actor(Kind.BLOCK, Pose(20.0, 2.0, 0.5)),), (), ())
        return RenderedCamera(world).render(0.0, (0.0, 0.0, -9.0), 0.0, 0.0, 0.0).image_bgr

    one = picture(3)
    assert np.array_equal(one, picture(3))
    assert not np.array_equal(one, picture(4))


def test_noise_changes_from_frame_to_frame_by_its_own_measure() -> None:
    camera = RenderedCamera(World(3, (_actor(Kind.BLOCK, Pose(20.0, 2.0, 0.5)),), (), ()), sensor=Sensor(noise_std=4.0))
    one, two = (camera.render(t, (0.0, 0.0, -9.0), 0.0, 0.0, 0.0).image_bgr.astype(float) for t in (0.0, 0.05))
    assert (one - two).std() == pytest.approx(4.0 * math.sqrt(2), rel=0.1)


@pytest.mark.parametrize("height_m", [0.0, 0.5, 2.0, 10.0, 60.0])
def test_every_height_and_attitude_renders(height_m: float) -> None:
    camera = _moving_camera()
    for roll, pitch, yaw in ((0.0, 0.0, 0.0), (0.6, 0.5, 2.0), (-0.6, -1.2, -1.0), (0.0, 1.5, 0.0), (3.1, 0.0, 0.0)):
        picture = camera.render(1.0, (13.0, 12.0, -height_m), roll, pitch, yaw).image_bgr
        assert picture.shape == (480, 640, 3)
        assert picture.dtype == np.uint8


def test_the_ground_has_texture_near_and_far() -> None:
    for height in (3.0, 9.0, 40.0):
        picture = _block_camera().render(0.0, (0.0, 0.0, -height), 0.0, 0.0, 2.0).image_bgr
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        for part in (grey[100:240], grey[300:460]):
            fine = part - cv2.GaussianBlur(part.astype(np.float32), (0, 0), 4)
            assert fine.std() > 2.5


@pytest.mark.parametrize("bad", [{"hfov_rad": 0.0}, {"hfov_rad": 3.0}, {"width_px": 4}, {"mount_pitch_rad": math.nan}])
def test_a_lens_out_of_range_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="camera:"):
        Lens(**bad)  # type: ignore[arg-type]


def test_the_sensors_noise_goes_on_while_the_scenario_waits() -> None:
    camera = _moving_camera()
    first, second = (camera.render(0.0, (0.0, 0.0, -9.0), 0.0, 0.0, 0.0, taken_t_s=t_s) for t_s in (5.0, 5.05))
    assert (first.image_bgr != second.image_bgr).any()
