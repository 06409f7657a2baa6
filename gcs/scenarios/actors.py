"""Target motions of the catalogue, in the mocks' own language: actors on paths of segments with speed profiles.

Places are NED metres; the vehicle hovers above the origin and looks north.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from sitl_mocks.scenario import load
from sitl_mocks.world import PATH_HORIZON_S, Actor, Kind, ObjectState, Path, Pose, Segment, SpeedProfile, World

Build = Callable[[int], World]
Speeds = tuple[tuple[float, float], ...]
AHEAD_M = 15.0
ON_THE_SPOT_M = 1e-3  # length of a turn that takes no room
# Some 40 px high and wide, on average, at 15 m: not a person, but what the filters' noise is stated for.
_POST_M, _CAR_M = (1.2, 1.2, 1.8), (4.3, 1.8, 1.45)
_ORANGE, _BLUE, _WHITE = (36, 110, 226), (150, 78, 36), (226, 230, 230)


class Moved(Actor):
    """An actor that is somewhere else than its path says: shift(t_s) gives metres north, east, down."""

    shift: Callable[[float], tuple[float, float, float]]

    def state(self, t_s: float) -> ObjectState:
        """The object at t_s; its velocity is that along the path."""
        state = super().state(t_s)
        north, east, down = (a + b for a, b in zip(state.position_ned_m, self.shift(t_s), strict=True))
        return replace(state, position_ned_m=(north, east, down))


def _target(start: Pose, segments: tuple[Segment, ...], speeds: Speeds, *, car: bool = False) -> Actor:
    kind, size, colour = (Kind.CAR, _CAR_M, _WHITE) if car else (Kind.PERSON, _POST_M, _ORANGE)
    return _actor("target", kind, size, colour, start, segments, speeds)


def _actor(
    name: str,
    kind: Kind,
    size_m: tuple[float, float, float],
    colour: tuple[int, int, int],
    start: Pose,
    segments: tuple[Segment, ...],
    speeds: Speeds,
) -> Actor:
    profile = SpeedProfile(speeds)
    return Actor(name, kind, size_m, colour, Path(start, segments, profile.at(PATH_HORIZON_S)[1]), profile)


def world(seed: int, *actors: Actor) -> World:
    """Those actors on open ground."""
    return World(seed, actors, (), ())


def recorded(name: str) -> Build:
    """The world of a scenario file of the mocks."""
    return partial(_recorded, name)


def _recorded(name: str, seed: int) -> World:
    return load(name, seed).world


def sine(seed: int) -> World:
    """Across at 15 m, 5 m/s at the fastest."""
    actor = Moved(
        "target", Kind.PERSON, _POST_M, _ORANGE, Path(Pose(AHEAD_M, 0.0, 0.0), (), 0.0), SpeedProfile(((0.0, 0.0),))
    )
    actor.shift = lambda t_s: (0.0, 8.0 * math.sin(5.0 / 8.0 * t_s), 0.0)
    return world(seed, actor)


def to_and_fro(seed: int) -> World:
    """Across at 15 m, always 5 m/s, turning on the spot every 4 s."""
    turn = Segment(ON_THE_SPOT_M, math.pi)
    leg = Segment(20.0 - ON_THE_SPOT_M)
    legs = (Segment(10.0 - ON_THE_SPOT_M / 2), turn, leg, turn, Segment(10.0 - ON_THE_SPOT_M / 2))
    return world(seed, _target(Pose(AHEAD_M, 0.0, math.pi / 2), legs, ((0.0, 5.0),)))


def straight(speeds: Speeds, heading_deg: float = 0.0, *, car: bool = False) -> Build:
    """From 15 m ahead in a straight line."""
    return partial(_straight, speeds, math.radians(heading_deg), car)


def _straight(speeds: Speeds, heading_rad: float, car: bool, seed: int) -> World:
    return world(seed, _target(Pose(AHEAD_M, 0.0, heading_rad), (Segment(100.0),), speeds, car=car))


def zigzag_away(seed: int) -> World:
    """5 m/s over ground, heading 45 degrees to either side of north, turning every 4 s."""
    right = math.pi / 2
    leg = Segment(20.0 - ON_THE_SPOT_M)
    legs = (leg, Segment(ON_THE_SPOT_M, -right), leg, Segment(ON_THE_SPOT_M, right))
    return world(seed, _target(Pose(AHEAD_M, 0.0, right / 2), legs, ((0.0, 5.0),)))


def u_turn(seed: int) -> World:
    """Away at 4 m/s, round within 4 m, and back past the vehicle; and again."""
    legs = (Segment(40.0), Segment(math.pi * 4.0, math.pi))
    return world(seed, _target(Pose(AHEAD_M, 0.0, 0.0), legs, ((0.0, 0.0), (2.0, 4.0))))


def crossing(seed: int) -> World:
    """Another that looks the same walks across, between the vehicle and the target, and back again."""
    actors = [_target(Pose(AHEAD_M, 0.0, 0.0), (Segment(100.0),), ((0.0, 0.0), (2.0, 2.0)))]
    for number, (north_m, start_s, heading) in enumerate(((33.5, 6.0, 1.0), (53.5, 16.0, -1.0))):
        start = Pose(north_m, -12.0 * heading, heading * math.pi / 2)
        speeds = ((0.0, 0.0), (start_s - 0.01, 0.0), (start_s, 2.0))
        actors.append(_actor(f"other{number}", Kind.PERSON, _POST_M, _ORANGE, start, (Segment(24.0),), speeds))
    return world(seed, *actors)


def dash(north_m: float, east_m: float, down_m: float, at_s: float = 8.0) -> Build:
    """Walks on, and from at_s on is away for two seconds: so far within half a second."""
    return partial(_dash, (north_m, east_m, down_m), at_s)


def _dash(away_ned_m: tuple[float, float, float], at_s: float, seed: int) -> World:
    def shift(t_s: float) -> tuple[float, float, float]:
        out = min(max((t_s - at_s) / 0.5, 0.0), 1.0) - min(max((t_s - at_s - 1.5) / 0.5, 0.0), 1.0)
        north_m, east_m, down_m = away_ned_m
        return north_m * out, east_m * out, down_m * out

    speeds = SpeedProfile(((0.0, 0.0), (2.0, 1.5)))
    path = Path(Pose(AHEAD_M, 0.0, 0.0), (Segment(100.0),), speeds.at(PATH_HORIZON_S)[1])
    actor = Moved("target", Kind.PERSON, _POST_M, _ORANGE, path, speeds)
    actor.shift = shift
    return world(seed, actor)


def hill(seed: int) -> World:
    """Up a slope of one in ten and down again, at 3 m/s."""
    speeds = SpeedProfile(((0.0, 0.0), (2.0, 3.0)))
    path = Path(Pose(AHEAD_M, 0.0, 0.0), (Segment(100.0),), speeds.at(PATH_HORIZON_S)[1])
    actor = Moved("target", Kind.PERSON, _POST_M, _ORANGE, path, speeds)

    def shift(t_s: float) -> tuple[float, float, float]:
        up_m = speeds.at(t_s)[1]
        return 0.0, 0.0, -0.1 * max(min(up_m, 80.0 - up_m), 0.0)

    actor.shift = shift
    return world(seed, actor)


def wanderer(seed: int) -> World:
    """Whatever comes: turns, stops and sprints, drawn from the seed; distance and size too."""
    rng = random.Random(seed * 7 + 3)
    ahead_m, size = rng.uniform(8.0, 28.0), rng.uniform(0.7, 1.8)
    legs: list[Segment] = []
    for _ in range(40):
        legs.append(Segment(rng.uniform(3.0, 30.0)))
        turn_rad = rng.uniform(-math.pi, math.pi)
        legs.append(Segment(max(abs(turn_rad) * rng.uniform(3.0, 15.0), ON_THE_SPOT_M), turn_rad))
    speeds, t_s = [(0.0, 0.0)], 0.5
    while t_s < 80.0:
        speeds.append((t_s, rng.choice((0.0, rng.uniform(0.5, 3.0), rng.uniform(2.0, 5.5)))))
        t_s += rng.uniform(0.7, 6.0)
    start = Pose(ahead_m, rng.uniform(-0.3, 0.3) * ahead_m, rng.uniform(-math.pi, math.pi))
    box_m = (1.2 * size, 1.2 * size, 1.8 * size)
    return world(seed, _actor("target", Kind.PERSON, box_m, _ORANGE, start, tuple(legs), tuple(speeds)))
