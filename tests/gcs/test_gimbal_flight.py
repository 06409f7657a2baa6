"""The whole station with the camera on a gimbal: the picture stays, the nose follows, and every end stops it."""

from __future__ import annotations

import asyncio
import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from control.engagement import State
from gcs.errors import GcsError
from gcs.gimbal import Hold
from gcs.operator.orders import Abort
from sitl_mocks.monitor import WireMonitor
from sitl_mocks.vehicle import MockGimbal
from tests.gcs.gimbal_rig import OTHER, Flight, Walk, fly, make_gimbal, rms
from tracker.box import Box

US = (255, 191)
STILL = ("rate", 0.0, 0.0)


def sine(t_s: float) -> float:
    return math.radians(60) * math.sin(2 * math.pi * t_s / 8)


def zigzag(t_s: float) -> float:
    return math.radians(45) * (1 if int(t_s / 4) % 2 else -1)


async def for_10_s(flight: Flight) -> Flight:
    await flight.follow()
    await asyncio.sleep(10.0)
    assert flight.world.flight.tick is not None
    assert flight.world.flight.tick.output.state is State.FOLLOWING
    return flight


@pytest.mark.parametrize(("heading", "across_deg"), [(sine, 1.5), (zigzag, 2.5)])
def test_the_target_stays_in_the_middle_and_the_nose_follows_slowly(heading, across_deg) -> None:
    flight = fly(for_10_s, target=Walk(heading))
    across, down = zip(*flight.off_rad, strict=True)
    assert rms(list(across)) < math.radians(across_deg)
    assert rms(list(down)) < math.radians(1.0)  # whatever the vehicle's pitch, which is some 15 degrees
    assert rms(flight.nose_rps) < 0.2
    assert max(map(abs, flight.relative_rad)) < math.radians(60)


def test_the_nose_is_handed_over_in_time_near_the_stop() -> None:
    flight = fly(for_10_s, target=Walk(sine), gimbal=lambda: make_gimbal(yaw_limit_rad=math.radians(30)))
    across, _ = zip(*flight.off_rad, strict=True)
    assert rms(list(across)) < math.radians(1.5)
    assert math.radians(10) < max(map(abs, flight.relative_rad)) < math.radians(29)


def test_without_a_yaw_axis_the_nose_turns_as_with_a_fixed_camera() -> None:
    flight = fly(for_10_s, target=Walk(sine), gimbal=lambda: make_gimbal(has_yaw=False))
    across, down = zip(*flight.off_rad, strict=True)
    assert rms(list(across)) < math.radians(3.0)
    assert rms(list(down)) < math.radians(1.0)


@pytest.mark.parametrize("options", [{"earth_frame": False}, {"yaw_lock": False}, {"response_s": 0.25}])
def test_other_gimbals_do_as_well(options) -> None:
    async def play(flight: Flight) -> Flight:
        await flight.follow()
        await asyncio.sleep(6.0)
        return flight

    flight = fly(play, target=Walk(sine), gimbal=lambda: make_gimbal(**options))
    across, _ = zip(*flight.off_rad, strict=True)
    assert rms(list(across)) < math.radians(2.0)


def test_a_lost_target_stops_the_gimbal_within_a_second_of_coasting() -> None:
    async def play(flight: Flight) -> MockGimbal:
        await flight.follow()
        await asyncio.sleep(4.0)
        assert flight.mock.command != STILL
        flight.world.eyes.hidden = True
        await asyncio.sleep(1.4)
        assert flight.gimbal.hold is Hold.OURS  # it may come back
        assert flight.mock.command == STILL
        await asyncio.sleep(4.0)
        return flight.mock

    mock = fly(play, target=Walk(sine))
    assert mock.command == STILL
    assert mock.primary == (0, 0)


@pytest.mark.parametrize("loss_frac", [0.0, 0.3])
def test_an_abort_stops_the_gimbal_at_once_and_gives_it_back(loss_frac: float) -> None:
    async def play(flight: Flight) -> None:
        await flight.follow()
        await asyncio.sleep(3.0)
        assert flight.mock.primary == US
        flight.world.vehicle.faults.drop_uplink = loss_frac
        await flight.orders.perform(Abort())
        await asyncio.sleep(0.05 if not loss_frac else 1.5)
        assert flight.mock.command == STILL
        await asyncio.sleep(2.0)
        assert flight.mock.primary == (0, 0)
        assert flight.gimbal.hold is Hold.FREE

    fly(play, target=Walk(sine))


def test_the_end_of_the_program_stops_the_gimbal_and_gives_it_back() -> None:
    async def play(flight: Flight) -> None:
        await flight.follow()
        await asyncio.sleep(3.0)
        flight.world.flight.stop()
        await asyncio.sleep(1.0)
        assert flight.mock.command == STILL
        assert flight.mock.primary == (0, 0)

    fly(play, target=Walk(sine))


def take_over(flight: Flight) -> None:
    """Another station takes primary control of the gimbal."""
    codec = mavlink.MAVLink(None, *OTHER)
    command = mavlink.MAVLink_command_long_message(1, 1, 1001, 0, *OTHER, -1, -1, 0, 0, 154)
    world = flight.world
    world.down_from_vehicle(world.vehicle.receive(command.pack(codec), world.loop.time()))


def test_who_takes_the_gimbal_from_us_keeps_it_and_hears_no_more_of_us() -> None:
    async def play(flight: Flight) -> None:
        await flight.follow()
        await asyncio.sleep(3.0)
        take_over(flight)
        await asyncio.sleep(0.3)
        assert flight.gimbal.hold is Hold.TAKEN
        refused = flight.mock.refused
        await asyncio.sleep(2.0)
        assert flight.mock.refused == refused  # not one more rate from us
        assert flight.mock.primary == OTHER
        assert "system 254" in flight.gimbal.warnings(flight.world.loop.time())[0]

    fly(play, target=Walk(sine, speed_mps=1.0))


def test_a_gimbal_that_refuses_is_asked_three_times_at_most_and_said_to() -> None:
    async def play(flight: Flight) -> None:
        flight.mock.grants = False
        await flight.follow()
        await asyncio.sleep(4.0)
        assert flight.gimbal.hold is Hold.REFUSED
        assert any("refused" in warning for warning in flight.world.flight.status().warnings)

    fly(play, target=Walk(speed_mps=0.5))


def test_with_a_stale_attitude_nothing_is_followed() -> None:
    async def play(flight: Flight) -> None:
        await flight.follow()
        await asyncio.sleep(4.0)
        flight.mock.silent = True
        await asyncio.sleep(1.6)
        tick = flight.world.flight.tick
        assert tick is not None
        assert tick.output.state in (State.LOST_HOLD, State.RELEASED)
        assert flight.mock.command == STILL
        assert any("attitude is not heard" in warning for warning in flight.world.flight.status().warnings)

    fly(play, target=Walk(sine))


def test_without_a_gimbals_attitude_a_confirmation_is_refused() -> None:
    async def play(flight: Flight) -> None:
        flight.mock.silent = True
        await asyncio.sleep(1.0)
        with pytest.raises(GcsError, match="the gimbal's attitude is not heard"):
            await flight.follow()

    fly(play)


def test_a_gimbal_left_turning_by_a_program_that_died_is_stopped() -> None:
    async def play(flight: Flight) -> None:
        await asyncio.sleep(1.0)
        assert flight.mock.command == STILL
        assert flight.mock.primary == (0, 0)

    def left_turning() -> MockGimbal:
        gimbal = make_gimbal()
        gimbal.primary, gimbal.command = US, ("rate", 0.0, 0.3)
        return gimbal

    fly(play, gimbal=left_turning)


def test_a_mirrored_camera_on_a_gimbal_is_found() -> None:
    async def play(flight: Flight) -> None:
        flight.world.eyes.distort = lambda box, now_s: Box(640.0 - box.cx_px, box.cy_px, box.w_px, box.h_px)
        await flight.follow()
        await asyncio.sleep(3.0)
        tick = flight.world.flight.tick
        assert tick is not None
        assert tick.output.state is State.RELEASED
        assert "mirrored" in tick.output.reasons[0].value

    fly(play, target=Walk(sine))


def test_the_same_seed_gives_the_same_bytes() -> None:
    async def play(flight: Flight) -> int:
        await flight.follow()
        await asyncio.sleep(2.0)
        return flight.world.exit.digest

    assert fly(play, target=Walk(sine), seed=3) == fly(play, target=Walk(sine), seed=3)


def test_the_judge_counts_a_gimbal_that_turns_while_nobody_flies_or_too_fast() -> None:
    async def play(flight: Flight) -> WireMonitor:
        world, codec = flight.world, mavlink.MAVLink(None, *US)
        judge = WireMonitor()
        for yaw_rate_rps in (0.0, 0.2, 9.0, math.inf):
            rates = mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(
                1, 1, 28, 154, math.nan, math.nan, 0, yaw_rate_rps
            )
            judge.feed(world.loop.time(), rates.pack(codec), world.vehicle.truth())
        return judge

    assert fly(play).summary()["by_rule"] == {"U1": 2, "U3": 3}
