"""The whole station in lockstep, the vehicle flying by its own follow mode after the target we publish."""

from __future__ import annotations

import math

import pytest

from control.modes import FollowMode
from gcs.operator.orders import Abort, SetMode, SetStandoff
from sitl_mocks.vehicle import Mode, Personality
from tests.gcs.follow_target_rig import NEEDED, Flown, Sine, WatchedWorld, fly

HOLD = {Personality.PX4: Mode.HOLD, Personality.ARDUPILOT: Mode.BRAKE}
both = pytest.mark.parametrize("personality", list(Personality))


def _hidden(world: WatchedWorld) -> None:
    world.eyes.hidden = True


def _seen(world: WatchedWorld) -> None:
    world.eyes.hidden = False


def _pilot(world: WatchedWorld) -> None:
    world.vehicle.pilot_sets_mode(Mode.POSITION)


def _speed_mps(published: object) -> float:
    return math.hypot(*published.message.vel)  # type: ignore[attr-defined]


def _clean(flown: Flown) -> None:
    assert flown.world.monitor.reasons == []
    assert not any("SET_" in kind or "MANUAL" in kind for kind in flown.world.kinds)
    assert not any("ALARM" in said or "steering" in said for said in flown.world.said)


def test_px4_goes_after_a_walker_until_the_pilot_takes_over() -> None:
    flown = fly(Personality.PX4, seconds=12.0, at={11.0: _pilot})
    _clean(flown)
    assert flown.answers[-1] == "follow confirmed 15.9 m away, by follow-target: 15 m away, 8 m above home"
    assert flown.modes[-2:] == [
        (pytest.approx(0.0, abs=0.2), Mode.FOLLOW),
        (pytest.approx(11.0, abs=0.02), Mode.POSITION),
    ]
    assert len(flown.since(0.0, 11.0)) == pytest.approx(110, abs=3)
    assert flown.error_m(3.0) < 1.3
    assert flown.velocity_error_mps(3.0) < 0.8
    distances_m = [d for t_s, d in flown.world.distances_m if t_s > flown.confirmed_s + 4.0]
    assert 12.0 < min(distances_m) < max(distances_m) < 18.0
    assert flown.sent[-1].t_s < flown.confirmed_s + 11.0 + 0.15  # the mode is asked for 50 times a second


def test_arducopter_goes_after_a_sine_until_the_operator_aborts() -> None:
    sine = Sine((15.5, 0.0, -0.8), weave_rad=0.0)
    flown = fly(Personality.ARDUPILOT, target=sine, seconds=14.0, at={12.0: Abort()})
    _clean(flown)
    assert flown.modes[-1][1] is Mode.BRAKE
    assert flown.modes[-1][0] == pytest.approx(12.0, abs=0.1)
    assert flown.error_m(3.0, 12.0) < 1.3
    assert flown.velocity_error_mps(3.0) < 1.0
    last = flown.sent[-1]
    assert _speed_mps(last) == 0.0
    assert last.t_s < flown.confirmed_s + 12.1
    assert flown.answers[-1] == "abort: zero, then hold"


@both
def test_a_hidden_target_slows_down_and_stands_and_the_vehicle_holds(personality: Personality) -> None:
    flown = fly(personality, seconds=13.0, at={4.0: _hidden, 6.0: _seen, 8.0: _hidden})
    _clean(flown)
    before, standing = flown.since(3.8, 4.0)[-1], flown.since(5.3, 6.0)
    assert _speed_mps(before) > 1.0
    assert {_speed_mps(p) for p in standing} == {0.0}
    assert len({p.message.lat for p in standing}) == 1
    ahead_m = math.dist(before.position_ned_m, standing[-1].position_ned_m)
    assert 0.2 < ahead_m < 0.9 * _speed_mps(before)  # it fades within a second
    assert all(_speed_mps(p) > 0.5 for p in flown.since(7.5, 8.0))  # seen again, followed again
    assert flown.modes[-1][1] is HOLD[personality]
    assert 9.0 < flown.modes[-1][0] < 11.2  # three seconds, less what it was unseen before
    assert flown.sent[-1].t_s < flown.confirmed_s + flown.modes[-1][0] + 0.3


@pytest.mark.parametrize(
    ("personality", "parameters", "reason"),
    [
        (Personality.ARDUPILOT, {}, "FOLL_ENABLE is 0, wanted 1"),
        (Personality.ARDUPILOT, {"FOLL_ENABLE": 1, "FOLL_SYSID": 1}, "FOLL_SYSID is 1, wanted 255, this station"),
        (Personality.ARDUPILOT, {**NEEDED[Personality.ARDUPILOT], "FOLL_OFS_X": -12}, "FOLL_OFS_Z is 0, wanted"),
        (Personality.PX4, {"FLW_TGT_DST": 2}, "FLW_TGT_DST is 2, wanted 5 to 80 m"),
    ],
)
def test_parameters_that_do_not_fit_refuse_in_one_line(
    personality: Personality, parameters: dict[str, float], reason: str
) -> None:
    flown = fly(personality, seconds=0.5, parameters=parameters)
    assert flown.answers[-1].startswith("not following: unsafe vehicle parameters: ")
    assert reason in flown.answers[-1]
    assert "\n" not in flown.answers[-1]
    assert flown.sent == []
    assert Mode.FOLLOW not in {mode for _, mode in flown.world.modes}


def test_what_the_vehicle_decides_is_said_and_not_for_an_order() -> None:
    flown = fly(seconds=1.0, at={0.1: SetMode(FollowMode.SPOTLIGHT), 0.2: SetStandoff(20.0)})
    assert "its own follow mode will keep the vehicle 15 m away, 8 m above home" in flown.world.said
    assert all(answer.startswith("not for an order: distance, height and side") for answer in flown.answers[-2:])
    assert "follow-target: 15 m away" in flown.world.flight.status_line()


def test_a_target_that_leads_out_of_the_fence_is_not_followed_there() -> None:
    start = Sine((15.5, 0.0, -0.8), weave_rad=0.0)
    flown = fly(Personality.PX4, target=start, speed_mps=6.0, seconds=30.0)
    _clean(flown)  # the judge counts what is outside
    assert flown.modes[-1][1] is Mode.HOLD
    assert 120.0 < flown.world.vehicle.pose().position_ned_m[0] < 150.0
    assert any("at or outside the fence" in said for said in flown.world.said)


def test_leaving_the_program_stops_the_target_and_holds() -> None:
    flown = fly(Personality.ARDUPILOT, seconds=3.0)
    assert flown.modes[-1][1] is Mode.FOLLOW
    assert flown.world.mode is Mode.BRAKE  # the rig ends the station
    assert _speed_mps(flown.sent[-1]) == 0.0
