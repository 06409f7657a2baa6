"""The world as a function of time: paths, speeds, scenarios and their clock."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath

import pytest

from sitl_mocks import scenario
from sitl_mocks.scenario import ScenarioClock, ScenarioError
from sitl_mocks.sequences.follower import follow
from sitl_mocks.world import Path, Pose, Segment, SpeedProfile


def test_a_path_of_a_straight_and_a_right_arc_ends_where_geometry_says() -> None:
    path = Path(Pose(0.0, 0.0, 0.0), (Segment(10.0), Segment(math.pi * 5, math.pi)), 10.0 + math.pi * 5)
    assert path.at(4.0) == Pose(4.0, 0.0, 0.0)
    end = path.at(path.length_m)
    # A half circle of 5 m radius to the right: 10 m further east, heading south.
    assert (end.north_m, end.east_m) == pytest.approx((10.0, 10.0), abs=1e-9)
    assert end.heading_rad == pytest.approx(math.pi)


def test_a_path_is_continuous_where_its_segments_repeat() -> None:
    path = Path(Pose(3.0, -2.0, 0.4), (Segment(7.0), Segment(6.0, -1.0)), 60.0)
    for joint in (7.0, 13.0, 20.0, 26.0):
        before, after = path.at(joint - 1e-6), path.at(joint + 1e-6)
        assert math.hypot(after.north_m - before.north_m, after.east_m - before.east_m) < 1e-5
        assert after.heading_rad == pytest.approx(before.heading_rad, abs=1e-5)


def test_distance_is_the_integral_of_speed() -> None:
    profile = SpeedProfile(((0.0, 0.0), (2.0, 4.0), (3.0, 4.0), (5.0, 0.0)))
    step = 1e-3
    summed = sum(profile.at((i + 0.5) * step)[0] * step for i in range(6000))
    speed, distance = profile.at(6.0)
    assert speed == 0.0
    assert distance == pytest.approx(summed, abs=1e-3)
    assert profile.at(-1.0) == (0.0, 0.0)


@pytest.mark.parametrize("points", [(), ((1.0, 2.0),), ((0.0, 1.0), (0.0, 2.0)), ((0.0, -1.0),), ((0.0, math.nan),)])
def test_a_bad_speed_profile_is_refused(points: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="speed profile"):
        SpeedProfile(points)


@pytest.mark.parametrize("name", scenario.names())
def test_a_scenario_lasts_and_moves_no_faster_than_the_vehicle_can(name: str) -> None:
    world = scenario.load(name).world
    last = world.target(0.0)
    for i in range(1, 1201):
        state = world.target(i * 0.1)
        moved = math.dist(state.position_ned_m, last.position_ned_m)
        assert moved <= 0.8 + 1e-6
        speed = math.hypot(*state.velocity_ned_mps)
        assert moved == pytest.approx(speed * 0.1, abs=0.08)
        last = state
    assert math.dist(last.position_ned_m, world.target(0.0).position_ned_m) > 10
    assert world.target(5.0) == world.target(5.0)


@pytest.mark.parametrize("name", scenario.names())
def test_the_target_stands_ahead_of_the_hover_point_at_first(name: str) -> None:
    loaded = scenario.load(name)
    first, later = loaded.world.target(0.0), loaded.world.target(5.0)
    assert first.position_ned_m == later.position_ned_m
    north, east, down = first.position_ned_m
    assert 10 <= math.hypot(north, east) <= 20
    assert abs(math.atan2(east, north) - loaded.heading_rad) < math.radians(10)
    assert down == 0.0


def test_a_seed_moves_the_trees_and_nothing_else() -> None:
    one, same, other = (scenario.load("demo", seed).world for seed in (5, 5, 6))
    assert one.props == same.props
    assert one.props != other.props
    assert one.target(30.0) == other.target(30.0)


def test_an_unknown_scenario_names_those_there_are() -> None:
    with pytest.raises(ScenarioError, match=r"'nothing' is not known.*demo"):
        scenario.load("nothing")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"colour_of_sky": 1}, "unknown key colour_of_sky"),
        ({"height_m": "high"}, r"height_m: must be a number"),
        ({"actors": [{"name": "target", "kind": "boat", "start": [0, 0, 0]}]}, "kind 'boat' is not one of"),
        ({"actors": [{"name": "target", "kind": "car", "start": [0, 0]}]}, r"actors\[0\].start: must be a list of 3"),
        ({"actors": []}, "needs at least one actor"),
        ({"seed": None}, "seed: must be a number"),
    ],
)
def test_a_mistake_in_a_scenario_file_is_named(tmp_path: FilePath, change: dict[str, object], text: str) -> None:
    content = {"text": "x", "seed": 1, "actors": [{"name": "target", "kind": "car", "start": [9, 0, 0]}]}
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(content))
    assert scenario.load(str(file)).name == "mine"
    file.write_text(json.dumps(content | change))
    with pytest.raises(ScenarioError, match=text):
        scenario.load(str(file))


def test_the_clock_waits_for_a_steady_height_and_the_delay() -> None:
    clock = ScenarioClock(move_after_s=2.0, speed=0.5)
    assert clock.update(0.0, 0.0, 0.0) == 0.0  # on the ground, steady but not flying
    assert clock.update(5.0, 4.0, 1.5) == 0.0  # climbing
    for t_s in (6.0, 6.5):
        assert clock.update(t_s, 9.0, 0.1) == 0.0
    assert clock.update(7.0, 9.0, 0.1) == 0.0  # steady for a second: the delay begins
    assert clock.update(9.0, 9.0, 0.1) == 0.0
    assert clock.update(11.0, 9.0, 2.0) == pytest.approx(1.0)  # two seconds at half speed; it never stops again


def test_the_clock_starts_over_when_the_climb_goes_on() -> None:
    clock = ScenarioClock()
    clock.update(0.0, 3.0, 0.0)
    clock.update(0.9, 3.0, 1.0)
    clock.update(1.5, 3.0, 0.0)
    assert clock.update(2.0, 3.0, 0.0) == 0.0
    clock.update(2.5, 3.0, 0.0)
    assert clock.update(3.5, 3.0, 0.0) == pytest.approx(1.0)


def test_the_scripted_follower_keeps_the_first_distance() -> None:
    loaded = scenario.load("demo")
    away = [
        math.dist(m.position_ned_m[:2], loaded.world.target(m.t_s).position_ned_m[:2])
        for m in follow(loaded, 5.0, 60.0)
    ]
    assert min(away) > away[0] - 3
    assert max(away) < away[0] + 3
