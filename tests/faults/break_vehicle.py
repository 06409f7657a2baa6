"""Faults of the vehicle, and what its pilot does: H6, H14 to H19, H26, H27, H38."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from control.fence import Fence
from gcs.lockstep.world import Setup
from sitl_mocks.vehicle import Mode, Result
from sitl_mocks.vehicle.streams import ATTITUDE, GLOBAL_POSITION_INT, LOCAL_POSITION_NED
from tests.faults.script import Happened, with_config
from tests.faults.world import FaultWorld

_SET_MODE = 176


def once_external(world: FaultWorld, act: Callable[[], None]) -> list[Mode]:
    """At once, or while the vehicle is being asked for external control as soon as it has it.

    Before that the vehicle obeys whoever spoke last: a request of ours that is under way wins over the pilot, and
    he has to speak again. `test_takeover` measures how long that window is. Our request for hold can do the same, so
    the mode the act brought about is what proves it.
    """
    modes: list[Mode] = []
    tick = world.flight.tick
    if tick is None or not tick.output.engaging:
        act()
        return [world.vehicle.autopilot.mode]

    def watch(now_s: float) -> None:
        if world.vehicle.autopilot.mode is Mode.EXTERNAL:
            world.hooks.remove(watch)
            world.caused(now_s)
            act()
            modes.append(world.vehicle.autopilot.mode)

    world.monitor.silent_by_s = None
    world.hooks.append(watch)
    return modes


def pilot_takes_over(world: FaultWorld) -> Happened:
    """The pilot turns the mode switch."""
    mode = world.random.choice((Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZE, Mode.LAND, Mode.RETURN))
    modes = once_external(world, lambda: world.vehicle.pilot_sets_mode(mode))
    return lambda: mode in modes


def pilot_moves_sticks(world: FaultWorld) -> Happened:
    """The pilot moves the sticks; PX4 takes them with COM_RC_OVERRIDE 3, ArduCopter by its mode switch."""
    vehicle = world.vehicle

    def move() -> None:
        if world.px4:
            vehicle.autopilot.pilot_moves_sticks()  # type: ignore[attr-defined]
        else:
            vehicle.pilot_sets_mode(Mode.POSITION)

    modes = once_external(world, move)
    return lambda: Mode.POSITION in modes


def failsafe(world: FaultWorld) -> Happened:
    """The vehicle decides by itself: battery, fence, position estimate."""
    mode = world.random.choice((Mode.RETURN, Mode.LAND))
    modes = once_external(world, lambda: world.vehicle.start_failsafe(mode))
    return lambda: mode in modes


def low_battery(world: FaultWorld) -> Happened:
    """The battery runs low in flight; a second later the vehicle flies home by itself, which is what is judged."""
    world.vehicle.battery_frac = 0.1
    world.monitor.silent_by_s = None
    happened: list[float] = []

    def go_home() -> None:
        world.caused(world.loop.time())
        happened.append(world.loop.time())
        world.vehicle.start_failsafe(Mode.RETURN)

    world.loop.call_later(1.0, go_home)
    return lambda: bool(happened) and world.vehicle.autopilot.mode is Mode.RETURN


def battery_low_before(world: FaultWorld) -> Happened:
    """The battery is low before the operator confirms."""
    world.vehicle.battery_frac = 0.2
    world.cause_is_motion()
    return lambda: world.telemetry.vehicle_state().battery_frac == 0.2


def external_refused(world: FaultWorld) -> Happened:
    """The vehicle refuses external control, in each of the ways there are, or says nothing."""
    answer = world.random.choice((*(result for result in Result if result is not Result.ACCEPTED), None))
    world.vehicle.faults.refuse[_SET_MODE] = answer
    world.cause_is_motion()
    return lambda: world.flight.tick is not None and world.vehicle.autopilot.mode is not Mode.EXTERNAL


def hold_refused(world: FaultWorld) -> Happened:
    """The operator aborts, and the vehicle refuses to hold."""
    answer = world.random.choice((*(result for result in Result if result is not Result.ACCEPTED), None))
    world.vehicle.faults.refuse[_SET_MODE] = answer
    mode = world.vehicle.autopilot.mode
    world.flight.abort()
    return lambda: (
        world.vehicle.faults.refuse[_SET_MODE] == answer
        and (mode is not Mode.EXTERNAL or not world.engaged_before or bool(world.said))
    )


def gps_lost(world: FaultWorld) -> Happened:
    """No position any more."""
    world.vehicle.faults.gps_lost = True
    world.vehicle.faults.stopped_streams.update((LOCAL_POSITION_NED, GLOBAL_POSITION_INT))
    return lambda: not world.vehicle.view(world.loop.time()).gps_ok


def telemetry_nan(world: FaultWorld) -> Happened:
    """Attitude or position full of NaN."""
    stream = world.random.choice((ATTITUDE, LOCAL_POSITION_NED))
    world.vehicle.faults.nan_streams.add(stream)
    return lambda: world.vehicle.streams.interval_s(stream) is not None


def _run_away(world: FaultWorld, speed_mps: float) -> None:
    world.target.heading_rad, world.target.weave_rad = 0.0, 0.0
    world.target.speed_mps = speed_mps


def small_fence(setup: Setup) -> Setup:
    """A fence that is soon reached, its judge a metre behind it."""
    fence = Fence(radius_m=14.0)
    limits = replace(setup.config.control.limits, fence=fence)
    return replace(with_config(setup, limits=limits), limits=replace(setup.limits, fence_radius_m=14.0))


def to_the_fence(world: FaultWorld) -> Happened:
    """The target runs on past the fence."""
    _run_away(world, world.random.uniform(4.0, 6.0))
    reached: list[bool] = [False]

    def watch(now_s: float) -> None:
        north, east, _ = world.vehicle.pose().position_ned_m
        reached[0] = reached[0] or math.hypot(north, east) > 8.0

    world.hooks.append(watch)
    return lambda: reached[0] or math.hypot(*world.target.position_ned_m[:2]) > 14.0


def low_ceiling(setup: Setup) -> Setup:
    """Floor and ceiling close around the height it flies at."""
    fence = Fence(min_height_m=8.0, max_height_m=10.0)
    limits = replace(setup.config.control.limits, fence=fence)
    judged = replace(setup.limits, height_min_m=8.0, height_max_m=10.0)
    return replace(with_config(setup, limits=limits), limits=judged)


def height_asked(world: FaultWorld) -> Happened:
    """The follow law is made to want full climb or full descent for good."""
    control, law = world.flight.control, world.flight.control._follow_law
    down_mps = world.random.choice((-1.5, 1.5))
    asked: list[float] = []

    def mad(*args: object, **kwargs: object) -> object:
        request = law(*args, **kwargs)  # type: ignore[arg-type]
        north, east, _ = request.velocity_ned_mps
        asked.append(down_mps)
        return replace(request, velocity_ned_mps=(north, east, down_mps))

    control._follow_law = mad  # type: ignore[method-assign, assignment]
    return lambda: bool(asked) or world.rested()


_ERRORS: tuple[tuple[str, Callable[[FaultWorld], None]], ...] = (
    ("nothing there", lambda world: setattr(world.eyes, "covered", True)),
    ("not sure", lambda world: setattr(world.eyes, "confidence", 0.3)),
    ("on the ground", lambda world: _on_the_ground(world)),
    ("disarmed", lambda world: setattr(world.vehicle.autopilot, "armed", False)),
    ("pilot flies", lambda world: world.vehicle.pilot_sets_mode(Mode.POSITION)),
    ("going home", lambda world: world.vehicle.start_failsafe(Mode.RETURN)),
    ("no video", lambda world: setattr(world.eyes, "running", False)),
    ("too low", lambda world: _at_height(world, 2.0)),
)


def _at_height(world: FaultWorld, height_m: float) -> None:
    world.vehicle.autopilot.flight.body.motion.position_ned_m = (0.0, 0.0, -height_m)
    world.vehicle.autopilot.flight.hold_ned_m = None


def _on_the_ground(world: FaultWorld) -> None:
    _at_height(world, 0.0)
    world.vehicle.autopilot.do_disarm()


def operator_errs(world: FaultWorld) -> Happened:
    """A confirmation that must be refused."""
    _, err = world.random.choice(_ERRORS)
    err(world)
    world.cause_is_motion()
    return lambda: True
