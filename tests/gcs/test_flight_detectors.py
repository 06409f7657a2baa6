"""What a flight finds out about itself, its camera and its link, in lockstep: cause, reaction, words."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.engagement import Action, Cause, State
from control.gate import TICK_S
from control.types import VehicleMode
from gcs.announcer import Announcer
from gcs.flight_control import Act, Tick
from gcs.link_health import LinkHealth
from gcs.statustext import StatusText
from gcs.telemetry import SetpointEcho
from tests.gcs.flight_rig import Rig, moving, still


def moving_rig() -> Rig:
    """A follow under way, the target walking off."""
    rig = Rig()
    rig.follow()
    rig.target_ned_m = (60.0, 20.0, 0.0)
    rig.run(1.5)
    assert moving(rig.ticks[-1])
    return rig


def fly(rig: Rig, seconds: float, echo_of_s: float = 0.1, strange: bool = False) -> list[Tick]:
    """Go on; the vehicle echoes what was sent echo_of_s ago, or by turns what was never sent."""
    ticks = []
    for step in range(round(seconds / TICK_S)):
        old = [tick.setpoint for tick in rig.ticks if tick.setpoint and tick.t_s <= rig.now_s - echo_of_s]
        velocity = old[-1].velocity_ned_mps if old else (0.0, 0.0, 0.0)
        if strange and step % 2:
            velocity = (-6.0, -6.0, 0.0)
        rig.link = LinkHealth(echo=SetpointEcho(rig.now_s, velocity))
        ticks += rig.run(TICK_S)
    return ticks


def first(ticks: list[Tick], cause: Cause) -> float:
    """Seconds from the first of these ticks until the cause ended the follow: zero and hold in that tick."""
    ends = [tick for tick in ticks if cause in tick.output.reasons]
    assert ends, f"{cause} never came: {ticks[-1].output}"
    assert ends[0].output.state is State.RELEASED
    assert ends[0].output.action is Action.COMMAND_HOLD
    assert still(ends[0])
    return ends[0].t_s - ticks[0].t_s + TICK_S


def test_an_up_to_date_echo_is_no_reason() -> None:
    rig = moving_rig()
    assert all(tick.output.state is State.FOLLOWING for tick in fly(rig, 5.0, echo_of_s=0.4))


def test_an_echo_that_stays_behind_ends_the_follow() -> None:
    rig = moving_rig()
    fly(rig, 1.0)
    rig.target_ned_m = (20.0, -30.0, 0.0)  # so that what is sent changes
    frozen_s = rig.now_s
    ticks = []
    for _ in range(60):
        ticks += fly(rig, TICK_S, echo_of_s=rig.now_s - frozen_s)
    assert first(ticks, Cause.ECHO_LOST) <= 3.0  # of that, the time until what is sent is another velocity
    differs = next(
        tick for tick in ticks
        if tick.setpoint and math.dist(tick.setpoint.velocity_ned_mps, ticks[0].setpoint.velocity_ned_mps) > 1.3  # type: ignore[union-attr]
    )  # fmt: skip
    assert first(ticks, Cause.ECHO_LOST) - (differs.t_s - ticks[0].t_s) <= 1.5


def test_an_echo_of_what_was_never_sent_ends_the_follow() -> None:
    rig = moving_rig()
    fly(rig, 1.0)
    assert first(fly(rig, 2.0, strange=True), Cause.FOREIGN_SETPOINTS) <= 1.5


def turn(rig: Rig, seconds: float, sign: float) -> list[Tick]:
    """The vehicle swings left and right; with sign -1 the picture moves the wrong way, as a mirrored camera's does."""
    ticks = []
    begun_s, rig.delay_s = rig.now_s, 0.0
    north_m, east_m, _ = rig.true_target
    bearing, distance_m = math.atan2(east_m, north_m), math.hypot(north_m, east_m)
    for _ in range(round(seconds / TICK_S)):
        yaw = 0.15 * (1 - math.cos(2.0 * (rig.now_s + TICK_S - begun_s)))
        rig.vehicle = replace(rig.vehicle, yaw_rad=yaw)
        seen = yaw + sign * (bearing - yaw)
        rig.place((distance_m * math.cos(seen), distance_m * math.sin(seen), 0.0))
        ticks += rig.run(TICK_S)
    return ticks


def test_a_mirrored_camera_ends_the_follow_and_refuses_the_next() -> None:
    rig = Rig()
    rig.follow()
    rig.run(1.0)
    assert first(turn(rig, 2.5, sign=-1.0), Cause.CAMERA_WRONG) <= 1.5
    rig.vehicle = replace(rig.vehicle, mode=VehicleMode.HOLD)
    rig.run(1.0)
    rig.run(TICK_S, Act.ACKNOWLEDGE)
    again = rig.run(TICK_S, Act.CONFIRM)[0].output
    assert Cause.CAMERA_WRONG in again.reasons
    assert not again.engaging
    rig.select()  # a new target is judged anew
    rig.run(1.0)
    assert Cause.CAMERA_WRONG not in rig.run(TICK_S, Act.CONFIRM)[0].output.reasons


def test_a_right_camera_turns_without_alarm() -> None:
    rig = Rig()
    rig.follow()
    rig.run(1.0)
    assert {tick.output.state for tick in turn(rig, 5.0, sign=1.0)} == {State.FOLLOWING}


def test_our_own_lag_refuses_for_two_seconds_and_is_told() -> None:
    rig = Rig()
    rig.run(3.0)
    rig.select()
    rig.run(1.0)
    rig.stall(0.3)
    refused = rig.run(TICK_S, Act.CONFIRM)[0].output
    assert refused.reasons == (Cause.OWN_LAG,)
    assert refused.warnings == (Cause.OWN_LAG,)
    assert Cause.OWN_LAG.value in rig.control.refusals(rig.now_s, rig.ticks[-1].inputs.vehicle)
    rig.run(2.05)
    assert rig.run(TICK_S, Act.CONFIRM)[0].output.engaging


@pytest.mark.parametrize("late_s", [0.5, 2.0])
def test_a_tracker_that_answers_too_late_is_as_none(late_s: float) -> None:
    """A deadline missed: the answer, though it comes, is of an old picture."""
    rig = moving_rig()
    rig.delay_s = late_s
    ticks = rig.run(4.0)
    assert not any(moving(tick) for tick in ticks if tick.t_s - ticks[0].t_s > 1.05)
    assert Cause.TARGET_LOST in ticks[-1].output.reasons


def test_the_battery_warns_in_flight_and_ends_nothing() -> None:
    rig = moving_rig()
    rig.vehicle = replace(rig.vehicle, battery_frac=0.2)
    for tick in rig.run(1.0):
        assert tick.output.state is State.FOLLOWING
        assert tick.output.warnings == (Cause.BATTERY,)


class Texts:
    """The part of Telemetry that an announcer needs."""

    def __init__(self) -> None:
        self.texts: list[StatusText] = []

    def texts_since(self, t_s: float, max_severity: int = 5) -> list[StatusText]:
        return [text for text in self.texts if text.t_s >= t_s and text.severity <= max_severity]


def test_each_thing_is_said_once() -> None:
    said: list[str] = []
    texts = Texts()
    rig = moving_rig()
    announcer = Announcer(texts, said.append, rig.now_s)  # type: ignore[arg-type]

    def go(seconds: float) -> None:
        for tick in rig.run(seconds):
            announcer.ticked(tick)

    go(1.0)
    assert said == ["FOLLOWING"]
    for _ in range(5):  # it flickers
        rig.link = LinkHealth(lossy=True, foreign_station=True)
        go(0.5)
        rig.link = LinkHealth()
        go(0.5)
    assert said[1:] == [f"WARNING: {Cause.LOSSY.value}", f"WARNING: {Cause.FOREIGN_STATION.value}"]
    go(11.0)
    rig.link = LinkHealth(lossy=True)
    go(0.5)
    assert said[3:] == [f"WARNING: {Cause.LOSSY.value}"]
    texts.texts.append(StatusText(rig.now_s, 3, "Compass error"))
    go(0.5)
    assert said[4:] == ["vehicle: Compass error"]
    rig.run(TICK_S, Act.ABORT)
    go(0.2)
    assert said[5:] == [f"RELEASED: {Cause.ABORT.value}"]
