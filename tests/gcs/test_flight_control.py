"""The deciding part of a flight, in lockstep: seconds of flight in milliseconds."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.engagement import Action, Cause, State
from control.gate import TICK_S
from control.types import Reason, VehicleMode
from gcs.flight_control import Act, Wanted
from tests.gcs.flight_rig import AIRBORNE, Rig, moving, still


def test_selecting_moves_nothing() -> None:
    rig = Rig()
    rig.run(3.0)
    rig.select()
    rig.run(3.0)
    assert rig.ticks[-1].output.state is State.SELECTED
    assert rig.ticks[-1].target is not None
    assert all(tick.setpoint is None and tick.output.action is Action.NONE for tick in rig.ticks)


def test_a_confirmed_follow_primes_engages_and_moves() -> None:
    rig = Rig()
    rig.run(3.0)
    rig.select()
    rig.run(1.0)
    engaging = rig.run(0.3, Act.CONFIRM)
    assert all(tick.output.action is Action.ENGAGE and still(tick) for tick in engaging)
    assert all(tick.gate is Reason.PRIMING for tick in engaging)
    rig.vehicle = replace(rig.vehicle, mode=VehicleMode.EXTERNAL)
    rig.target_ned_m = (24.0, 4.0, 0.0)  # further away and to the right
    following = rig.run(2.0)
    assert all(tick.output.state is State.FOLLOWING for tick in following)
    last = following[-1].setpoint
    assert last is not None
    assert last.velocity_ned_mps[0] > 0.5
    assert last.yaw_rate_rps > 0.02
    confirmation = rig.control.confirmation
    assert confirmation is not None
    assert confirmation.standoff_m == pytest.approx(
        math.hypot(16.0, 1.0), rel=0.06
    )  # this box is centred on the ground


def test_no_gap_and_no_trim_in_a_healthy_follow() -> None:
    rig = Rig()
    rig.follow()
    for step in range(200):
        rig.target_ned_m = (16.0 + 0.05 * step, math.sin(step / 30), 0.0)
        rig.run(TICK_S)
    ticks = rig.ticks[-200:]
    assert all(tick.setpoint is not None for tick in ticks)
    assert {tick.gate for tick in ticks} == {Reason.PASSED}


def test_the_pilot_always_wins_and_we_stay_silent() -> None:
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(rig.run(1.0)[-1])
    rig.vehicle = replace(rig.vehicle, mode=VehicleMode.MANUAL)
    after = rig.run(2.0)
    assert all(tick.setpoint is None for tick in after)
    assert all(tick.output.action is Action.SILENCE for tick in after)
    assert after[0].output.state is State.TAKEN_OVER
    rig.vehicle = replace(rig.vehicle, mode=VehicleMode.EXTERNAL)  # the pilot gives it back: still not ours
    again = rig.run(1.0, Act.CONFIRM)
    assert all(tick.setpoint is None for tick in again)
    assert Cause.ACKNOWLEDGE in again[0].output.reasons


def test_abort_is_zero_in_the_same_tick_then_hold() -> None:
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(rig.run(1.0)[-1])
    aborted = rig.run(TICK_S, Act.ABORT)[0]
    assert still(aborted)
    assert aborted.output.action is Action.COMMAND_HOLD
    rig.vehicle = replace(rig.vehicle, mode=VehicleMode.HOLD)
    rest = rig.run(2.0)
    assert not any(moving(tick) for tick in rest)
    assert rest[-1].output.action is Action.SILENCE
    assert not rig.control.is_engaged


def test_a_gap_of_our_own_ends_the_follow_until_confirmed_anew() -> None:
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(rig.run(1.0)[-1])
    rig.stall(0.3)
    after = rig.run(1.0)
    assert after[0].output.reasons == (Cause.OWN_GAP,)
    assert after[0].setpoint is None  # what has just come in may be old: listen first
    assert after[3].output.action is Action.COMMAND_HOLD
    assert still(after[3])
    assert not any(moving(tick) for tick in after)


@pytest.mark.parametrize("fault", ["video", "sees", "frozen"])
def test_an_unseen_target_fades_to_zero_and_is_released(fault: str) -> None:
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(rig.run(1.5)[-1])
    setattr(rig, fault, fault == "frozen")
    lost = rig.run(4.0)
    states = [tick.output.state for tick in lost]
    for state in (State.COASTING, State.LOST_HOLD, State.RELEASED):
        assert state in states
    late = [tick for tick in lost if tick.t_s - lost[0].t_s > 1.05]
    assert not any(moving(tick) for tick in late)
    assert lost[-1].output.action is Action.COMMAND_HOLD


def test_a_target_back_in_time_is_followed_on() -> None:
    rig = Rig()
    rig.follow()
    rig.run(1.0)
    rig.sees = False
    assert State.COASTING in [tick.output.state for tick in rig.run(0.8)]
    rig.sees = True
    assert rig.run(0.5)[-1].output.state is State.FOLLOWING


def test_stale_telemetry_stops_us() -> None:
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(rig.run(1.0)[-1])
    rig.telemetry = False
    after = rig.run(2.0)
    assert not any(moving(tick) for tick in after if tick.t_s - after[0].t_s > 0.55)
    assert Cause.TELEMETRY_STALE in after[-1].output.reasons


def test_every_reason_against_a_confirmation_is_given() -> None:
    rig = Rig(telemetry=False, video=False, vehicle=replace(AIRBORNE, armed=False, in_air=False, height_m=0.0))
    rig.run(1.0)
    refused = rig.run(TICK_S, Act.CONFIRM)[0].output.reasons
    for cause in (Cause.NOT_SELECTED, Cause.NO_VIDEO, Cause.LINK_LOST, Cause.TELEMETRY_STALE, Cause.NOT_ARMED):
        assert cause in refused
    assert rig.control.refusals(rig.now_s, rig.vehicle)[0] == Cause.NOT_SELECTED.value
    assert rig.ticks[-1].setpoint is None


def test_an_unknown_distance_is_refused_with_its_reason_and_can_be_typed() -> None:
    rig = Rig(target_ned_m=(30.0, 0.0, -9.0))  # at eye level: height and angle tell nothing
    rig.run(3.0)
    rig.select()
    rig.run(1.0)
    assert Cause.NO_DISTANCE in rig.run(TICK_S, Act.CONFIRM)[0].output.reasons
    assert "type a distance" in rig.control.refusals(rig.now_s, rig.ticks[-1].inputs.vehicle)[-1]
    rig.control.wanted = Wanted(distance_m=30.0, standoff_m=20.0)
    assert rig.run(TICK_S, Act.CONFIRM)[0].output.engaging
    confirmation = rig.control.confirmation
    assert confirmation is not None
    assert confirmation.standoff_m == 20.0


def test_a_new_selection_forgets_the_old_target() -> None:
    rig = Rig()
    rig.run(1.0)
    rig.select()
    rig.run(1.0)
    assert rig.ticks[-1].target is not None
    rig.sees = False
    rig.select()
    rig.run(0.2)
    assert rig.ticks[-1].target is None
    assert rig.ticks[-1].inputs.measured_t_s is None


def test_outside_the_fence_is_released() -> None:
    rig = Rig()
    rig.follow()
    rig.vehicle = replace(rig.vehicle, position_ned_m=(151.0, 0.0, -9.0))
    tick = rig.run(TICK_S)[0]
    assert tick.output.reasons == (Cause.OUTSIDE_FENCE,)
    assert still(tick)


def test_the_last_zero_of_an_orderly_end_passes_the_gate() -> None:
    rig = Rig()
    rig.follow()
    rig.run(1.0)
    now_s, vehicle = rig.now_s + TICK_S, rig.ticks[-1].inputs.vehicle
    setpoint = rig.control.zero(now_s, vehicle)
    assert setpoint is not None
    assert setpoint.velocity_ned_mps == (0.0, 0.0, 0.0)
    taken = replace(vehicle, mode=VehicleMode.MANUAL)
    assert rig.control.zero(now_s + TICK_S, taken) is None
