"""One flight with a fault in it: select, confirm, fly on to a phase, break something, watch what happens."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from control.engagement import State
from gcs.errors import GcsError
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from gcs.operator.orders import Confirm, Select
from sitl_mocks.monitor import Rule
from sitl_mocks.vehicle import Personality
from tests.faults.world import FaultWorld
from tracker.box import Box

_READY_S: Final = 1.0  # streams flow, attitude is known
_LOOK_S: Final = 0.6  # between select and confirm
_REST_S: Final = 0.5
_LONGEST_S: Final = 60.0  # of fake time: a run that hangs fails
_STILL_MPS: Final = 0.8


class Phase(Enum):
    """When the fault comes."""

    ENGAGING = "engaging"  # confirmed, the vehicle has not taken up external control yet
    ACCELERATING = "accelerating"  # just confirmed
    STEADY = "steady"
    COASTING = "coasting"  # the target unseen for less than a second
    LOST = "lost or released"


class Expect(Enum):
    """What must be true in the end, besides no unsafe outcome and nothing moving after the bound."""

    RELEASED = "released"  # we stopped, commanded hold, and are silent; the vehicle holds
    TAKEN_OVER = "silent"  # somebody else has it: not one setpoint after the bound
    ENDED = "stopped"  # zero or silent, whoever was first
    REFUSED = "refused"  # external control was never entered
    GOES_ON = "goes on"  # the follow is not disturbed
    SAFE = "safe"  # may go on or stop: no unsafe outcome
    CRASHED = "program ended"  # a fault of our own ends the program: zero, hold, silence
    ANY = "any"  # as SAFE, and not even the vehicle's own moves or the state are judged
    GONE = "gone"  # our program is gone: silent at once, the vehicle stops by its own time-out


Happened = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Fault:
    """One row of the hazard table. inject breaks something in a running world and returns the proof that it did.

    bound_s: from the fault to the last setpoint that may move the vehicle (to the last of any kind where it must be
    silent). prepare: what must be so before the flight.
    """

    hazard: int
    name: str
    expect: Expect
    inject: Callable[[FaultWorld], Happened]
    bound_s: float | None = None
    prepare: Callable[[Setup], Setup] = lambda setup: setup
    phases: tuple[Phase, ...] = tuple(Phase)
    before: Callable[[FaultWorld], object] | None = None  # broken before the operator selects, besides
    from_start: bool = False  # it is there before the operator selects; the bound counts from the first motion
    watch_s: float = 2.5  # how long after the fault

    @property
    def label(self) -> str:
        """H7 and its name."""
        return f"H{self.hazard} {self.name}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one run came to; problems is empty where it is well."""

    label: str
    phase: Phase
    seed: int
    last_moving_s: float | None  # after the fault; None: none moved after it
    went_on: bool  # still following, or again, in the end
    unsafe: int
    problems: tuple[str, ...]
    digest: int
    flown_s: float


@dataclass(slots=True)
class Flown:
    """What the judge looks at besides the world."""

    happened: Happened | None = None
    refusal: str = ""
    crash: str = ""


def fly(fault: Fault, phase: Phase, seed: int) -> Outcome:
    """One run; the same arguments give the same bytes."""
    personality = (Personality.PX4, Personality.ARDUPILOT)[seed % 2]
    setup = fault.prepare(Setup(seed * 5 + list(Phase).index(phase), personality))
    return lockstep.run(lambda loop: _run(loop, setup, fault, phase, seed))


async def _run(loop: LockstepLoop, setup: Setup, fault: Fault, phase: Phase, seed: int) -> Outcome:
    world, flown = FaultWorld(loop, setup), Flown()
    start_s = loop.time()
    stepping = loop.create_task(world.run())
    flight = loop.create_task(_fly_station(world))
    flight.add_done_callback(lambda task: _note_end(task, flown))
    async with asyncio.timeout(_LONGEST_S):
        await _play(world, fault, phase, flown, flight)
    outcome = _judge(world, fault, phase, seed, flown, loop.time() - start_s)
    for undo in world.undo:
        undo()
    for task in (stepping, flight):
        task.cancel()
    with contextlib.suppress(BaseException):
        await asyncio.gather(stepping, flight, return_exceptions=True)
    return outcome


async def _fly_station(world: FaultWorld) -> None:
    await world.wire.wait_vehicle(_READY_S)
    await world.flight.run()


def _note_end(task: asyncio.Task[None], flown: Flown) -> None:
    if not task.cancelled() and task.exception() is not None:
        flown.crash = repr(task.exception())


async def _play(world: FaultWorld, fault: Fault, phase: Phase, flown: Flown, flight: asyncio.Task[None]) -> None:
    rng, loop = world.random, world.loop

    def _break_in(now: Phase) -> None:
        if flown.happened is None and (phase is Phase.ENGAGING) == (now is Phase.ENGAGING):
            _break(world, fault, flown)

    world.monitor.phase = "follow"
    await world.wire.wait_vehicle(_READY_S)  # of two vehicles the one heard first is ours
    if fault.before is not None:
        fault.before(world)
    if fault.from_start:
        _break(world, fault, flown)
    engaging = loop.create_task(engage(world, flown, lambda: _break_in(Phase.ENGAGING)))
    await asyncio.wait([engaging, flight], return_when=asyncio.FIRST_COMPLETED)  # an ended flight answers nobody
    if not engaging.done():
        engaging.cancel()
    else:
        engaging.result()  # what the operator's orders raise beyond a refusal ends a real flight
    await _go_on_to(world, phase)
    _break_in(phase)
    if phase in (Phase.COASTING, Phase.LOST):  # the target shows up again: a temptation to fly on
        loop.call_later(rng.uniform(0.1, 0.6), lambda: setattr(world.eyes, "hidden", False))
    await asyncio.sleep(fault.watch_s)


async def _go_on_to(world: FaultWorld, phase: Phase) -> None:
    rng = world.random
    match phase:
        case Phase.ACCELERATING:
            await asyncio.sleep(rng.uniform(0.2, 0.9))
        case Phase.STEADY:
            await asyncio.sleep(rng.uniform(1.5, 3.0))
        case Phase.COASTING:
            await asyncio.sleep(rng.uniform(1.2, 1.8))
            world.eyes.hidden = True
            await asyncio.sleep(rng.uniform(0.36, 0.95))
        case Phase.LOST:
            await asyncio.sleep(rng.uniform(1.2, 1.8))
            world.eyes.hidden = True
            await asyncio.sleep(rng.uniform(1.15, 3.6))


async def engage(world: FaultWorld, flown: Flown, meanwhile: Callable[[], None]) -> None:
    """The operator selects and confirms; `meanwhile` is called while the vehicle is asked for external control."""
    orders, rng = Orders(world.flight), world.random
    await asyncio.sleep(_READY_S + rng.uniform(0.0, 0.05))
    box = box_of(world.target.position_ned_m, world.vehicle.pose()) or Box(320.0, 240.0, 60.0, 60.0)
    try:
        await orders.perform(Select(box))
        await asyncio.sleep(_LOOK_S)
        heading_rad = rng.uniform(-1.2, 1.2)
        world.target.heading_rad = heading_rad if world.target_heading_rad is None else world.target_heading_rad
        world.target.speed_mps = rng.uniform(2.0, 3.5)
        world.monitor.operator_confirms(world.loop.time())
        world.loop.call_later(rng.uniform(0.0, 0.12), meanwhile)
        await orders.perform(Confirm())
    except GcsError as error:
        flown.refusal = str(error)


def _break(world: FaultWorld, fault: Fault, flown: Flown) -> None:
    world.bound_s = fault.bound_s
    world.silent = fault.expect in (Expect.TAKEN_OVER, Expect.GONE)
    if not fault.from_start:
        world.caused(world.loop.time())
    flown.happened = fault.inject(world)


def _judge(world: FaultWorld, fault: Fault, phase: Phase, seed: int, flown: Flown, flown_s: float) -> Outcome:
    monitor, now_s = world.monitor, world.loop.time()
    problems = [f"{r.rule.value} at {r.t_s - world.cause_s:+.3f} s: {r.text}" for r in monitor.reasons]
    problems += world.exit.faults[:3]
    if flown.happened is None or not flown.happened():
        problems.append("the fault did not happen")
    in_motion = phase in (Phase.ACCELERATING, Phase.STEADY) and not (fault.from_start or fault.expect is Expect.ANY)
    if in_motion and not world.was_moving:
        problems.append(f"the vehicle was not being moved before the fault ({flown.refusal or 'no refusal'})")
    last_s = world.exit.last_s(moving=not world.silent)
    late_s = last_s - world.cause_s if last_s is not None and last_s > world.cause_s else None
    if fault.bound_s is not None and late_s is not None and late_s > fault.bound_s:
        problems.append(f"last {'setpoint' if world.silent else 'moving setpoint'} {late_s:.3f} s after the fault")
    went_on = world.exit.any_moving(now_s - _REST_S, now_s)
    problems += _unexpected(world, fault.expect, went_on, flown, phase)
    unsafe = sum(count for rule, count in monitor.counts.items() if rule is not Rule.UNAVAILABLE)
    return Outcome(fault.label, phase, seed, late_s, went_on, unsafe, tuple(problems), world.exit.digest, flown_s)


def _unexpected(world: FaultWorld, expect: Expect, went_on: bool, flown: Flown, phase: Phase) -> list[str]:
    tick, truth, now_s = world.flight.tick, world.vehicle.truth(), world.loop.time()
    state = tick.output.state if tick is not None else State.NO_VIDEO
    said = f"{state.value}, external {truth.external}, {'; '.join(world.said[-3:])} {flown.refusal}"
    newest_s = world.exit.last_s(moving=False)
    quiet = newest_s is None or now_s - newest_s > _REST_S
    its_own = world.vehicle.autopilot.failsafe is not None  # a failsafe of the vehicle may fly it home
    still = its_own or math.hypot(*world.vehicle.pose().velocity_ned_mps) < _STILL_MPS
    if flown.crash and expect not in (Expect.CRASHED, Expect.ANY):
        return [f"the flight ended: {flown.crash}"]
    match expect:
        case Expect.RELEASED if not (world.engaged_before or world.monitor.external_entries):
            pass  # it came before the follow had begun, which it kept from beginning
        case Expect.RELEASED if not (state is State.RELEASED and quiet and still and not truth.external):
            return [f"expected released, silent and the vehicle in hold: {said}"]
        case Expect.TAKEN_OVER if state not in (State.TAKEN_OVER, State.RELEASED) and world.engaged_before:
            return [f"expected taken over: {said}"]
        case Expect.ENDED | Expect.CRASHED | Expect.GONE if went_on or not still:
            return [f"expected an end and the vehicle standing: {said}"]
        case Expect.REFUSED if world.monitor.external_entries:
            return [f"external control was entered: {said}"]
        case Expect.REFUSED if not flown.refusal:
            return [f"nothing was refused: {said}"]
        case Expect.GOES_ON if not went_on and phase is not Phase.LOST:
            return [f"the follow did not go on: {said}"]
    return []


def with_config(setup: Setup, **control: object) -> Setup:
    """Another control configuration: sections by name."""
    return replace(setup, config=replace(setup.config, control=replace(setup.config.control, **control)))  # type: ignore[arg-type]
