"""The glass delay out of rotation: against attitudes and pictures whose delay is known, and where none can be known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from control.attitude import AttitudeBuffer
from control.camera import CameraModel
from control.image_rotation import Flow, rotation_of_flow
from control.latency import DelayEstimate, GlassDelayEstimator
from gcs.lockstep.background import ground_motion
from sitl_mocks.lens import Lens
from sitl_mocks.vehicle import Pose

LENS = Lens()
MOUNT = (0.0, LENS.mount_pitch_rad, 0.0)
CAMERA = CameraModel.from_hfov(LENS.width_px, LENS.height_px, LENS.hfov_rad, mount_rpy_rad=MOUNT)
BEGIN_S = 100.0
Mangle = Callable[[Flow], Flow]


@dataclass(frozen=True)
class Motion:
    """A vehicle that weaves: angles are sums of two sines whose phases come from the seed; velocity in m/s."""

    seed: int = 0
    yaw_rad: float = 0.25
    tilt_rad: float = 0.06
    speed_mps: float = 5.0

    def pose(self, t_s: float) -> Pose:
        """Where it is at t_s, 9 m high."""
        phases = np.random.default_rng(self.seed).uniform(0.0, 2 * math.pi, 6)
        slow, quick = (np.sin(w * t_s + p) for w, p in ((1.4, phases[:3]), (3.1, phases[3:])))
        roll, pitch, yaw = np.array([self.tilt_rad, self.tilt_rad, self.yaw_rad]) * (slow + 0.4 * quick)
        # To and fro across the way, as what follows a weaving target does: parallax that goes with the turning.
        east_m = 0.4 * self.speed_mps * math.sin(1.4 * t_s + phases[2])
        place = (self.speed_mps * (t_s - BEGIN_S), east_m, -9.0)
        return Pose(t_s, place, (self.speed_mps, 0.0, 0.0), float(roll), float(pitch), float(yaw), 0.0)


def watched(
    motion: Motion,
    delay_s: float,
    *,
    fps: float = 20.0,
    seconds: float = 10.0,
    camera: CameraModel = CAMERA,
    mangle: Mangle = lambda flow: flow,
) -> DelayEstimate:
    """The estimate after so long; attitude at 50 Hz, pictures up to 5 ms later than they should be."""
    rng = np.random.default_rng(motion.seed + 1)
    attitude = AttitudeBuffer()
    estimator = GlassDelayEstimator(camera, attitude)
    heard_s = BEGIN_S - 1.0
    before: tuple[Pose, float] | None = None
    for count in range(round(seconds * fps)):
        shot_s = BEGIN_S + count / fps
        arrival_s = shot_s + delay_s + rng.uniform(-0.0025, 0.0025)
        while heard_s <= arrival_s:
            told = motion.pose(heard_s)
            attitude.add(heard_s, told.roll_rad, told.pitch_rad, told.yaw_rad)
            heard_s += 0.02
        pose = motion.pose(shot_s)
        if before is not None:
            points = ground_motion(LENS, before[0], pose, 1000 * motion.seed + count)
            estimator.add(mangle(Flow(before[1], arrival_s, *points)))
        before = pose, arrival_s
    return estimator.estimate


@pytest.mark.parametrize("fps", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("delay_s", [0.01, 0.1, 0.25, 0.4])
def test_ten_seconds_of_motion_tell_the_delay(delay_s: float, fps: float) -> None:
    found = watched(Motion(seed=round(fps + 1000 * delay_s)), delay_s, fps=fps)
    assert found.known
    assert found.delay_s == pytest.approx(delay_s, abs=0.01)
    assert found.std_s < 0.01


@pytest.mark.parametrize("motion", [Motion(yaw_rad=0.0, tilt_rad=0.0), Motion(yaw_rad=0.004, tilt_rad=0.002)])
def test_without_rotation_nothing_is_known(motion: Motion) -> None:
    """Flying past the ground is no turning."""
    assert not watched(motion, 0.1).known


def test_three_seconds_are_too_short() -> None:
    assert not watched(Motion(), 0.1, seconds=2.5).known


def test_a_delay_longer_than_any_candidate_is_not_known() -> None:
    assert not watched(Motion(), 0.75).known


def mirrored(flow: Flow) -> Flow:
    start, end = flow.from_px.copy(), flow.to_px.copy()
    start[:, 0], end[:, 0] = LENS.width_px - start[:, 0], LENS.width_px - end[:, 0]
    return replace(flow, from_px=start, to_px=end)


def upside_down(flow: Flow) -> Flow:
    size = (LENS.width_px, LENS.height_px)
    return replace(flow, from_px=size - flow.from_px, to_px=size - flow.to_px)


def held_still(flow: Flow) -> Flow:
    """As a gimbal does."""
    return replace(flow, to_px=flow.from_px + np.random.default_rng(3).normal(0.0, 0.3, flow.from_px.shape))


@pytest.mark.parametrize("mangle", [mirrored, upside_down, held_still])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_picture_that_turns_otherwise_tells_nothing(mangle: Mangle, seed: int) -> None:
    assert not watched(Motion(seed=seed), 0.1, mangle=mangle).known


@pytest.mark.parametrize("hfov_deg", [58.0, 85.0])
def test_a_wrong_focal_length_does_not_spoil_the_delay(hfov_deg: float) -> None:
    camera = CameraModel.from_hfov(LENS.width_px, LENS.height_px, math.radians(hfov_deg), mount_rpy_rad=MOUNT)
    found = watched(Motion(seed=5), 0.15, camera=camera)
    assert found.known
    assert found.delay_s == pytest.approx(0.15, abs=0.02)


def test_one_glitch_of_the_video_is_passed_over() -> None:
    def glitch(flow: Flow) -> Flow:
        return replace(flow, to_px=flow.to_px + 400.0) if 104.0 < flow.to_t_s < 104.06 else flow

    found = watched(Motion(seed=6), 0.1, mangle=glitch)
    assert found.known
    assert found.delay_s == pytest.approx(0.1, abs=0.01)


def rotation(fps: float = 20.0, speed_mps: float = 5.0, camera: CameraModel = CAMERA, lens: Lens = LENS) -> float:
    """The largest error (rad) of the measured rotation vector over a second; the truth by finite differences."""
    motion, worst = Motion(seed=4, speed_mps=speed_mps), 0.0
    for count in range(round(fps)):
        before, after = (motion.pose(BEGIN_S + (count + k) / fps) for k in (0, 1))
        axes = [lens.camera_from_ned(p.roll_rad, p.pitch_rad, p.yaw_rad) for p in (before, after)]
        turn = axes[0] @ axes[1].T
        truth = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        flow = Flow(0.0, 1 / fps, *ground_motion(lens, before, after, count))
        found = rotation_of_flow(camera, flow, axes[0] @ (0.0, 0.0, 1.0))
        assert found is not None
        worst = max(worst, float(np.abs(found - truth).max()))
    return worst


def test_the_rotation_is_measured_past_the_parallax() -> None:
    assert rotation() < 0.004
    assert rotation(speed_mps=0.0) < 0.004


def test_distortion_is_undone() -> None:
    distortion = (-0.35, 0.08, 0.001, -0.001, 0.0)
    lens = replace(LENS, distortion=distortion)
    assert rotation(camera=replace(CAMERA, distortion=distortion), lens=lens, fps=10.0) < 0.003
    assert rotation(camera=CAMERA, lens=lens, fps=10.0) > 0.005  # not undone, it shows


def test_points_that_do_not_agree_tell_nothing() -> None:
    rng = np.random.default_rng(0)
    here, there = rng.uniform(0.0, 480.0, (30, 2)), rng.uniform(0.0, 480.0, (30, 2))
    down = LENS.camera_from_ned(0.0, 0.0, 0.0) @ (0.0, 0.0, 1.0)
    assert rotation_of_flow(CAMERA, Flow(0.0, 0.05, here[:5], here[:5]), down) is None
    few = rotation_of_flow(CAMERA, Flow(0.0, 0.05, here, here), down)
    assert few is not None
    assert np.abs(few).max() < 1e-6
    wild = rotation_of_flow(CAMERA, Flow(0.0, 0.05, here, there), down)
    assert wild is None or np.abs(wild).max() > 0.3  # faster than any camera turns: dropped by the estimator
