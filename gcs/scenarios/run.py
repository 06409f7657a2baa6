"""One flight of one scenario: the real station selects, confirms and follows, and the truth is written down."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
from collections.abc import Coroutine
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

from control.engagement import State
from gcs.config import Config, EngineName, GimbalConfig, TrackerConfig
from gcs.errors import GcsError
from gcs.flight_control import Wanted
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import LIMITS, Setup, World, camera_of
from gcs.operator.orders import Confirm, Select
from gcs.scenarios.catalogue import Scenario
from gcs.scenarios.conditions import FENCE_M, Conditions, LawKind, TrackerKind
from gcs.scenarios.eyes import JudgedTracker, ModelConfig, ModelTracker, PaintedEyes, StageEyes
from gcs.scenarios.measure import Row, Sample, measure
from gcs.scenarios.naive import NaiveLaw, gain_ps, yaw_tau_s
from gcs.scenarios.stage import Stage, outlines
from gcs.tracking import make_tracker
from sitl_mocks.dynamics import ARDUPILOT, PX4, Disturbance
from sitl_mocks.lens import Lens
from sitl_mocks.link_faults import Conditions as LinkConditions
from sitl_mocks.vehicle import MockGimbal, Personality
from tracker.box import Box

_READY_S: Final = 1.0  # streams flow, attitude is known
_HEARD_S: Final = 5.0  # until a heartbeat has come through a lossy link
_LOOK_S: Final = 0.6  # between select and confirm
_TRACK_S: Final = 0.02
_EVERY_STEPS: Final = 5
_TICK_S: Final = 0.01
_TRIES: Final = 3  # a lossy link may keep a confirmation from being accepted


@dataclass(slots=True)
class Flown:
    """All that is known of a flight: samples since the confirmation, and the row they make."""

    samples: list[Sample] = field(default_factory=list)
    row: Row | None = None
    refusal: str = ""


def fly(scenario: Scenario, conditions: Conditions) -> Row:
    """Fly it once; the same arguments give the same bytes."""
    row = fly_and_keep(scenario, conditions).row
    assert row is not None
    return row


def fly_and_keep(scenario: Scenario, conditions: Conditions) -> Flown:
    """The same, with every sample."""
    return lockstep.run(lambda loop: _fly(loop, scenario, conditions))


async def _fly(loop: LockstepLoop, scenario: Scenario, conditions: Conditions) -> Flown:
    stage = Stage(scenario.build(conditions.seed), scenario.start_s, scenario.covered)
    world = World(loop, _setup(scenario, conditions), stage, _eyes(scenario, conditions, stage))
    if conditions.law is LawKind.NAIVE:
        _steer_naively(world, conditions)
    stepping, flight = loop.create_task(world.run()), loop.create_task(_station(world))
    flown = Flown()
    recorder = _Recorder(world, stage, scenario, flown)
    try:
        await _beside(_engage(world, stage, scenario, conditions, flown), flight, stepping)
        if not flown.refusal:
            recorder.begin()
            await _beside(asyncio.sleep(scenario.duration_s), flight, stepping)
        flown.row = measure(scenario, conditions, flown.samples, world, flown.refusal)
    finally:
        for task in (stepping, flight):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(stepping, flight, return_exceptions=True)
    return flown


async def _beside(work: Coroutine[Any, Any, None], *tasks: asyncio.Task[None]) -> None:
    """Do it while the tasks live; what ends one of them is a fault of ours and is raised."""
    working = asyncio.get_running_loop().create_task(work)
    done, _ = await asyncio.wait([working, *tasks], return_when=asyncio.FIRST_COMPLETED)
    working.cancel()
    for task in done:
        task.result()


async def _station(world: World) -> None:
    await world.wire.wait_vehicle(_HEARD_S)
    await world.flight.run()


def _setup(scenario: Scenario, conditions: Conditions) -> Setup:
    glass_s = max(conditions.delay_s - _TRACK_S + conditions.delay_error_s, 0.0) if conditions.delay_given else None
    control = conditions.config
    if scenario.faster_mps is not None:
        limits = replace(control.limits, max_speed_mps=scenario.faster_mps)
        control = replace(control, limits=limits, follow=replace(control.follow, max_speed_mps=scenario.faster_mps))
    # A lossy link makes steps of velocity look quicker than they left.
    steady = conditions.loss_frac == 0.0
    judged = replace(
        LIMITS,
        fence_radius_m=FENCE_M,
        height_min_m=2.0,
        accel_max_mps2=LIMITS.accel_max_mps2 if steady else math.inf,
        yaw_accel_max_rps2=LIMITS.yaw_accel_max_rps2 if steady else math.inf,
    )
    lens = _lens(scenario, conditions)
    return Setup(
        conditions.seed,
        conditions.personality,
        Config(camera=camera_of(lens, glass_s), gimbal=GimbalConfig(enabled=conditions.gimbal), control=control),
        scenario.height_m,
        judged,
        lens=lens,
        link=LinkConditions(loss_frac=conditions.loss_frac, delay_s=conditions.link_delay_s),
        airframe=conditions.airframe,
        disturbance=Disturbance(conditions.wind_ned_mps, conditions.gust_mps, seed=conditions.seed),
        attitude_rate_hz=conditions.attitude_rate_hz,
        tick_s=_TICK_S,
        gimbal=partial(MockGimbal, pitch_rad=scenario.lens.mount_pitch_rad) if conditions.gimbal else None,
    )


def _lens(scenario: Scenario, conditions: Conditions) -> Lens:
    """A gimbal begins where the fixed camera would look."""
    return replace(scenario.lens, mount_pitch_rad=0.0) if conditions.gimbal else scenario.lens


def _eyes(scenario: Scenario, conditions: Conditions, stage: Stage) -> StageEyes:
    real = conditions.tracker is TrackerKind.REAL
    eyes = (PaintedEyes if real else StageEyes)(
        random.Random(conditions.seed + 5),
        _lens(scenario, conditions),
        fps=conditions.fps,
        glass_s=max(conditions.delay_s - _TRACK_S, 0.0),
        track_s=_TRACK_S,
        stage=stage,
    )
    if isinstance(eyes, PaintedEyes):
        eyes.tracker = JudgedTracker(
            eyes, make_tracker(TrackerConfig(weights="compact", engine=EngineName.TORCH, threads=1))
        )
    else:
        eyes.tracker = ModelTracker(eyes, ModelConfig(noise_px=conditions.noise_px))
    return eyes


def _steer_naively(world: World, conditions: Conditions) -> None:
    airframe = conditions.airframe or (PX4 if conditions.personality is Personality.PX4 else ARDUPILOT)
    law = NaiveLaw(gain_ps(conditions.delay_s, conditions.fps, yaw_tau_s(airframe)))
    world.flight.watchers = (*world.flight.watchers, law)
    world.flight.control.law = law


async def _engage(world: World, stage: Stage, scenario: Scenario, conditions: Conditions, flown: Flown) -> None:
    """The operator draws the true box and confirms; the world moves from then on."""
    orders = Orders(world.flight)
    world.flight.control.wanted = Wanted(mode=conditions.mode or scenario.mode)
    await world.wire.wait_vehicle(_HEARD_S)
    await asyncio.sleep(_READY_S)
    for _ in range(_TRIES):
        flown.refusal = ""
        try:
            await orders.perform(Select(_true_box(world, stage)))
            await asyncio.sleep(_LOOK_S)
            world.monitor.operator_confirms(world.loop.time())
            await orders.perform(Confirm())
            return
        except GcsError as error:
            flown.refusal = str(error)
            await asyncio.sleep(_READY_S)


def _true_box(world: World, stage: Stage) -> Box:
    if isinstance(world.eyes, PaintedEyes) and world.eyes.painted is not None:
        return world.eyes.painted
    seen = outlines([stage.target], world.vehicle.pose().of_camera, world.setup.lens)
    return seen[0].box if seen else Box(320.0, 240.0, 40.0, 40.0)


class _Recorder:
    """Samples the truth as often as setpoints leave, and lets the scenario disturb the vehicle."""

    def __init__(self, world: World, stage: Stage, scenario: Scenario, flown: Flown) -> None:
        self._world, self._stage, self._scenario, self._flown = world, stage, scenario, flown
        self._begun_s, self._steps = math.inf, 0

    def begin(self) -> None:
        """The operator has confirmed."""
        self._begun_s = self._world.loop.time()
        self._stage.begin(self._begun_s)
        self._world.hooks.append(self._step)

    def _step(self, now_s: float) -> None:
        t_s = now_s - self._begun_s
        if self._scenario.disturb is not None:
            self._scenario.disturb(self._world, t_s)
        if self._steps % _EVERY_STEPS == 0:
            self._flown.samples.append(self._sample(t_s))
        self._steps += 1

    def _sample(self, t_s: float) -> Sample:
        world, eyes = self._world, self._world.eyes
        assert isinstance(eyes, StageEyes)
        pose, tick = world.vehicle.pose(), world.flight.tick
        setpoint = tick.setpoint if tick is not None else None
        return Sample(
            t_s,
            self._stage.t_s,
            pose.position_ned_m,
            pose.of_camera.yaw_rad,
            self._stage.position_ned_m,
            tick.output.state if tick is not None else State.IDLE,
            eyes.newest.box is not None if eyes.newest is not None else False,
            eyes.newest.is_hit if eyes.newest is not None else False,
            setpoint.velocity_ned_mps if setpoint is not None else (0.0, 0.0, 0.0),
            setpoint.yaw_rate_rps if setpoint is not None else 0.0,
            pose.velocity_ned_mps,
        )
