from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.camera import CameraModel
from control.engagement import State
from control.types import Reason
from gcs.config import Config, FollowChoice, FollowConfig
from gcs.dryrun.rehearsal import ASSUMED_DISTANCE_M, Pose, Rehearsal, Tick
from tracker.box import Box, TrackResult

CAMERA = CameraModel.from_hfov(640, 480, math.radians(70))
CENTRE = Box(320.0, 240.0, 40.0, 40.0)


def fly(
    rehearsal: Rehearsal, seconds: float, confidence: float = 0.9, start_s: float = 0.0, box: Box = CENTRE
) -> list[Tick]:
    """20 fps of one box."""
    ticks = []
    for index in range(round(seconds * 20)):
        t_s = start_s + index / 20
        ticks += rehearsal.advance(t_s)
        rehearsal.observe(t_s, TrackResult(box, 1.0, confidence), Pose())
    return ticks


def test_a_centred_target_at_its_distance_asks_for_nothing() -> None:
    rehearsal = Rehearsal(CAMERA, Config())
    ticks = fly(rehearsal, 3.0)
    assert rehearsal.distance_was_assumed  # level camera, target on the horizon
    last = ticks[-1]
    assert last.state is State.FOLLOWING
    assert last.would_be is not None
    assert last.would_be.velocity_ned_mps == pytest.approx((0, 0, 0), abs=0.02)
    assert last.would_be.reason is Reason.PASSED


def test_ticks_come_at_20_hz_whatever_the_frame_rate() -> None:
    rehearsal = Rehearsal(CAMERA, Config())
    times = []
    for t_s in (0.0, 0.13, 0.26, 0.39, 0.52):
        times += [tick.t_s for tick in rehearsal.advance(t_s)]
        rehearsal.observe(t_s, TrackResult(CENTRE, 1.0, 0.9), Pose())
    assert times == pytest.approx([i * 0.05 for i in range(11)])


def test_a_target_on_the_right_turns_to_the_right_and_a_shrinking_one_is_approached() -> None:
    rehearsal = Rehearsal(CAMERA, Config())
    ticks = fly(rehearsal, 2.0, box=Box(480, 240, 40, 40))
    assert ticks[-1].would_be is not None
    assert ticks[-1].would_be.yaw_rate_rps > 0.2
    rehearsal = Rehearsal(CAMERA, Config())
    fly(rehearsal, 1.0)
    ticks = []
    for index in range(40):
        t_s = 1.0 + index / 20
        ticks += rehearsal.advance(t_s)
        side = 40.0 * math.exp(-0.25 * index / 20)
        view = rehearsal.observe(t_s, TrackResult(Box(320, 240, side, side), 1.0, 0.9), Pose())
    assert ticks[-1].would_be is not None
    assert ticks[-1].would_be.velocity_ned_mps[0] > 1.0
    assert view.distance_m is not None
    assert view.distance_m == pytest.approx(ASSUMED_DISTANCE_M * math.exp(0.25 * 39 / 20), rel=0.1)


def test_an_unseen_target_goes_through_coasting_and_hold_to_release_and_is_taken_up_again() -> None:
    rehearsal = Rehearsal(CAMERA, Config())
    fly(rehearsal, 1.0, box=Box(480, 240, 40, 40))
    lost = fly(rehearsal, 6.0, confidence=0.01, start_s=1.0)
    states = list(dict.fromkeys(tick.state for tick in lost))
    assert states[:4] == [State.FOLLOWING, State.COASTING, State.LOST_HOLD, State.RELEASED]
    moving = [t for t in lost if t.would_be and any((*t.would_be.velocity_ned_mps, t.would_be.yaw_rate_rps))]
    assert moving
    assert max(t.t_s for t in moving) < 1.0 + 1.1  # docs/safety.md: zero 1.05 s after the last sight
    again = fly(rehearsal, 2.0, start_s=7.0)
    assert again[-1].state is State.FOLLOWING


def test_with_telemetry_the_distance_comes_from_height_and_view_angle() -> None:
    camera = CameraModel.from_hfov(640, 480, math.radians(70), mount_rpy_rad=(0.0, math.radians(-30), 0.0))
    rehearsal = Rehearsal(camera, Config())
    for index in range(20):
        rehearsal.advance(index / 20)
        view = rehearsal.observe(index / 20, TrackResult(CENTRE, 1.0, 0.9), Pose(height_m=12.0))
    assert not rehearsal.distance_was_assumed
    assert view.standoff_m == pytest.approx(
        12.0 / math.tan(math.radians(30)), rel=0.06
    )  # taken a little nearer: the box reaches below
    assert view.predicted is not None
    assert (view.predicted.cx_px, view.predicted.cy_px) == pytest.approx((320, 240), abs=1)


def test_spotlight_asks_for_no_motion_but_yaw() -> None:
    config = replace(Config(), follow=FollowConfig(mode=FollowChoice.SPOTLIGHT))
    ticks = fly(Rehearsal(CAMERA, config), 2.0, box=Box(500, 240, 40, 40))
    assert ticks[-1].would_be is not None
    assert ticks[-1].would_be.velocity_ned_mps == (0, 0, 0)
    assert ticks[-1].would_be.yaw_rate_rps > 0.2


def test_an_unsure_tracker_is_never_confirmed() -> None:
    ticks = fly(Rehearsal(CAMERA, Config()), 2.0, confidence=0.3)
    assert {tick.state for tick in ticks} <= {State.SELECTED, State.NO_VIDEO}
    assert all(tick.would_be is None for tick in ticks)


def test_a_hole_in_the_recording_is_not_filled_with_ticks() -> None:
    rehearsal = Rehearsal(CAMERA, Config())
    fly(rehearsal, 1.0)
    assert rehearsal.advance(10_000.0) == []
