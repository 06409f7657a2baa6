"""The scenarios that following is measured by."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

from control.modes import FollowMode
from gcs.errors import GcsError
from gcs.lockstep.world import World
from gcs.scenarios import actors
from gcs.scenarios.conditions import Conditions
from gcs.scenarios.stage import Spans
from sitl_mocks.lens import Lens
from sitl_mocks.vehicle import Personality

LENS: Final = Lens(hfov_rad=math.radians(75), mount_pitch_rad=math.radians(-15))
_HIGH_LENS: Final = Lens()


class ScenarioNameError(GcsError):
    """There is no such scenario."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """What moves, and how it is looked at.

    start_s: the scenario's own time at the confirmation. covered: in its own time, when nothing shows the target; gone:
    when it is out of the picture, or covered by what is in the world. settle_s: after the confirmation, not measured.
    disturb: called with the world in each step and the time since the confirmation.
    """

    name: str
    text: str
    build: actors.Build
    mode: FollowMode = FollowMode.FOLLOW
    height_m: float = 5.0
    lens: Lens = field(default=LENS)
    start_s: float = 0.0
    duration_s: float = 40.0
    settle_s: float = 6.0
    covered: Spans = ()
    gone: Spans = ()
    disturb: Callable[[World, float], None] | None = None
    faster_mps: float | None = None  # what the vehicle may fly at most, where the default is too slow

    @property
    def unseen(self) -> Spans:
        """When the target cannot be seen."""
        return (*self.covered, *self.gone)


def _kick_yaw(world: World, t_s: float) -> None:
    """Something turns the vehicle by a jerk, to either side in turns."""
    if t_s % 3.0 < 0.01:
        motion = world.vehicle.autopilot.flight.body.motion
        motion.yaw_rate_rps += 0.7 if t_s % 6.0 < 3.0 else -0.7


def _heave(world: World, t_s: float) -> None:
    """Rising and sinking air: 1 m/s up and down, in turns."""
    motion = world.vehicle.autopilot.flight.body.motion
    north, east, down = motion.position_ned_m
    motion.position_ned_m = (north, east, down - 0.01 * math.sin(2 * math.pi * t_s / 10.0))


_WALK: Final = ((0.0, 0.0), (2.0, 1.5))
_RUN: Final = ((0.0, 0.0), (2.0, 3.0))
_STOP_AND_GO: Final = tuple((float(t), v) for t, v in zip(range(0, 80, 2), (0.0, 0.0, 4.0, 4.0) * 10, strict=True))


def _occlusion(text: str, length_s: float) -> Scenario:
    return Scenario(
        f"occlusion-{text}s",
        f"at 3 m/s, and nothing to be seen of it for {text} s",
        actors.straight(_RUN, 20.0),
        duration_s=25.0,
        covered=((9.0, 9.0 + length_s),),
    )


def _leaving(side: str, north_m: float, east_m: float, down_m: float) -> Scenario:
    return Scenario(
        f"leaving-{side}",
        f"out of the picture {side} for two seconds, quicker than anything can follow, and back",
        actors.dash(north_m, east_m, down_m),
        duration_s=25.0,
        gone=((8.0, 10.0),),
    )


def _recorded(name: str, text: str, lens: Lens = _HIGH_LENS, height_m: float = 9.0, start_s: float = 7.0) -> Scenario:
    build = actors.recorded(name)
    return Scenario(f"mock-{name}", text, build, height_m=height_m, lens=lens, start_s=start_s, duration_s=60.0)


_ALL: Final = (
    Scenario("sine", "across at 15 m, to and fro, 5 m/s at the fastest", actors.sine),
    Scenario("zigzag", "across at 15 m, to and fro at 5 m/s, turning on the spot", actors.to_and_fro),
    Scenario("walk", "straight away at 1.5 m/s", actors.straight(_WALK)),
    Scenario("zigzag-away", "away at 5 m/s, 45 degrees to either side", actors.zigzag_away),
    Scenario(
        "car",
        "a car accelerates to 8 m/s",
        actors.straight(((0.0, 0.0), (2.0, 0.0), (12.0, 8.0)), 10.0, car=True),
        duration_s=30.0,
        faster_mps=10.0,
    ),
    Scenario("u-turn", "away at 4 m/s, round within 4 m, and back", actors.u_turn),
    Scenario("stop-and-go", "4 m/s and standing, in turns", actors.straight(_STOP_AND_GO, 15.0)),
    _occlusion("0.5", 0.5),
    _occlusion("2", 2.0),
    _occlusion("5", 5.0),
    Scenario(
        "distractor", "another that looks the same crosses between", actors.crossing, duration_s=30.0, settle_s=4.0
    ),
    _leaving("left", 0.0, -30.0, 0.0),
    _leaving("right", 0.0, 30.0, 0.0),
    _leaving("above", 0.0, 0.0, -25.0),
    _leaving("below", -13.5, 0.0, 0.0),
    Scenario(
        "approach",
        "straight at the vehicle, 3 m/s for 6 s",
        actors.straight(((0.0, 0.0), (3.0, 0.0), (4.0, 3.0), (10.0, 3.0), (11.0, 0.0)), 180.0),
        duration_s=20.0,
        settle_s=3.0,
    ),
    Scenario("yawing", "something turns the vehicle by jerks", actors.straight(_WALK, 30.0), disturb=_kick_yaw),
    Scenario("hill", "the target goes up a slope of one in ten, and down", actors.hill, duration_s=35.0),
    Scenario("heave", "rising and sinking air moves the vehicle", actors.straight(_WALK, 30.0), disturb=_heave),
    _recorded("straight", "a car, straight on at 4 m/s"),
    _recorded("zigzag", "a car that zig-zags at 3.5 m/s"),
    _recorded("u-turn", "a car that turns round and comes back"),
    _recorded("stop-and-go", "a car that stops again and again, up to 5 m/s"),
    _recorded("distractor", "cars of the same make overtake and cross"),
    _recorded("walk", "a person with wide turns and a stop", height_m=6.0, start_s=5.0),
)
SCENARIOS: Final[Mapping[str, Scenario]] = MappingProxyType({scenario.name: scenario for scenario in _ALL})


def find(name: str) -> Scenario:
    """By name. ScenarioNameError with those there are."""
    try:
        return SCENARIOS[name]
    except KeyError:
        raise ScenarioNameError(f"scenario {name!r} is not known; there are: {', '.join(SCENARIOS)}") from None


@dataclass(frozen=True, slots=True)
class Case:
    """A row of the table: a scenario, how it is flown, and whether it belongs to the quick part."""

    scenario: Scenario
    conditions: Conditions
    note: str = ""
    quick: bool = False

    @property
    def mode(self) -> FollowMode:
        """What is confirmed."""
        return self.conditions.mode or self.scenario.mode

    @property
    def label(self) -> str:
        """Its name in the table and in the reference."""
        c = self.conditions
        words = [self.scenario.name, self.mode.value, f"{1000 * c.delay_s:.0f}ms", f"{c.fps:.0f}fps", c.tracker.value]
        return " ".join([*words, *([self.note] if self.note else [])])


def cases() -> tuple[Case, ...]:
    """The whole table."""
    slow = Conditions(delay_s=0.25, fps=10.0)
    found = []
    for name in ("sine", "zigzag"):
        for mode in (FollowMode.SPOTLIGHT, FollowMode.FOLLOW):
            for delay_s in (0.1, 0.25):
                for fps in (20.0, 10.0):
                    found.append(Case(find(name), Conditions(mode=mode, delay_s=delay_s, fps=fps), "", fps == 20.0))
    others = [scenario for scenario in _ALL if scenario.name not in ("sine", "zigzag")]
    quick = ("walk", "car", "u-turn", "stop-and-go", "occlusion-2s", "distractor", "leaving-left", "approach", "yawing")
    found += [Case(scenario, Conditions(), "", scenario.name in quick) for scenario in others]
    found += [Case(scenario, slow) for scenario in others if not scenario.name.startswith("mock-")]
    found += _hard()
    return tuple(found)


def _hard() -> list[Case]:
    """Wind, a bad link, a delay that is not given, another autopilot, a gimbal."""
    plain = Conditions()
    windy = replace(plain, wind_ned_mps=(-4.0, 3.0, 0.0), gust_mps=0.5)
    cases = []
    for name in ("sine", "zigzag-away"):
        scenario = find(name)
        cases += [
            Case(scenario, windy, "wind"),
            Case(scenario, replace(plain, loss_frac=0.05), "5% lost"),
            Case(scenario, replace(plain, loss_frac=0.2), "20% lost", quick=name == "zigzag-away"),
            Case(scenario, replace(plain, attitude_rate_hz=5.0), "attitude 5Hz", quick=name == "sine"),
            Case(scenario, replace(plain, delay_error_s=0.02), "delay +20ms"),
            Case(scenario, replace(plain, delay_error_s=-0.02), "delay -20ms"),
            Case(scenario, replace(plain, personality=Personality.ARDUPILOT), "ardupilot"),
        ]
    cases += [
        Case(find(name), replace(plain, delay_s=delay_s, delay_given=False), "delay estimated", name == "sine")
        for name in ("sine", "zigzag")
        for delay_s in (0.1, 0.25)
    ]
    on_gimbal = replace(plain, gimbal=True)
    return cases + [Case(find(name), on_gimbal, "gimbal", name == "sine") for name in ("sine", "zigzag", "zigzag-away")]
