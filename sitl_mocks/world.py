"""What there is in the mocked world, as a pure function of time: moving actors and standing props.

Frame: NED in metres, origin at the vehicle's home on flat ground (down = 0). Headings are clockwise from north.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

Vec3 = tuple[float, float, float]
Colour = tuple[int, int, int]  # blue, green, red, 0..255

PATH_HORIZON_S = 600.0  # paths are unrolled to here; an actor stands still afterwards


class Kind(Enum):
    """How an object is drawn."""

    CAR = "car"
    PERSON = "person"
    TREE = "tree"
    BLOCK = "block"  # a concrete box: bridge deck, pier, wall
    HOUSE = "house"


@dataclass(frozen=True, slots=True)
class Pose:
    """A place on the ground and the direction of travel."""

    north_m: float
    east_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class Segment:
    """A piece of a path: a straight (turn_rad 0) or an arc, positive turns are to the right."""

    length_m: float
    turn_rad: float = 0.0

    def __post_init__(self) -> None:
        if not self.length_m > 0 or not math.isfinite(self.length_m) or not math.isfinite(self.turn_rad):
            raise ValueError(f"path segment: length must be positive and finite, got {self.length_m}")

    def advance(self, start: Pose, s_m: float) -> Pose:
        """The pose s_m metres after `start` along this segment."""
        rate = self.turn_rad / self.length_m
        psi, turned = start.heading_rad, rate * s_m
        # sin(x)/x form of the chord: exact for arcs and well-behaved for straights.
        chord = s_m * _sinc(turned / 2)
        mid = psi + turned / 2
        return Pose(start.north_m + chord * math.cos(mid), start.east_m + chord * math.sin(mid), psi + turned)


def _sinc(x: float) -> float:
    return 1.0 - x * x / 6 if abs(x) < 1e-4 else math.sin(x) / x


class Path:
    """Segments end to end, repeated from the end pose of the last for as long as needed."""

    def __init__(self, start: Pose, segments: tuple[Segment, ...], length_m: float) -> None:
        """length_m: the least length to unroll; with no segments the path is one point."""
        self._segments: list[Segment] = []
        self._starts: list[Pose] = [start]
        self._offsets_m: list[float] = [0.0]
        while segments and self._offsets_m[-1] < length_m:
            for segment in segments:
                self._segments.append(segment)
                self._starts.append(segment.advance(self._starts[-1], segment.length_m))
                self._offsets_m.append(self._offsets_m[-1] + segment.length_m)

    @property
    def length_m(self) -> float:
        """The unrolled length."""
        return self._offsets_m[-1]

    def at(self, s_m: float) -> Pose:
        """The pose at arc length s_m, clamped to the path."""
        s_m = min(max(s_m, 0.0), self.length_m)
        index = bisect_right(self._offsets_m, s_m) - 1
        if index >= len(self._segments):
            return self._starts[-1]
        return self._segments[index].advance(self._starts[index], s_m - self._offsets_m[index])


def _time_of(point: tuple[float, float]) -> float:
    return point[0]


class SpeedProfile:
    """Speed over time, linear between (t_s, speed_mps) points; the last speed lasts."""

    def __init__(self, points: tuple[tuple[float, float], ...]) -> None:
        if not points or points[0][0] != 0.0:
            raise ValueError("speed profile: must start at t = 0")
        if any(b[0] <= a[0] for a, b in pairwise(points)):
            raise ValueError("speed profile: times must increase")
        if any(not (math.isfinite(t) and math.isfinite(v) and v >= 0) for t, v in points):
            raise ValueError("speed profile: speeds must be finite and not negative")
        self._points = points
        self._distance_m = [0.0]
        for (t0, v0), (t1, v1) in pairwise(points):
            self._distance_m.append(self._distance_m[-1] + 0.5 * (v0 + v1) * (t1 - t0))

    def at(self, t_s: float) -> tuple[float, float]:
        """(speed_mps, distance_m travelled) at t_s; before zero it stands at the start."""
        if t_s <= 0.0:
            return 0.0, 0.0
        index = bisect_right(self._points, t_s, key=_time_of) - 1
        t0, v0 = self._points[index]
        dt_s = t_s - t0
        if index + 1 == len(self._points):
            return v0, self._distance_m[-1] + v0 * dt_s
        t1, v1 = self._points[index + 1]
        speed = v0 + (v1 - v0) * dt_s / (t1 - t0)
        return speed, self._distance_m[index] + 0.5 * (v0 + speed) * dt_s


@dataclass(frozen=True, slots=True)
class ObjectState:
    """One object at one time. size_m: length along the heading, width, height; position: middle of its base."""

    name: str
    kind: Kind
    position_ned_m: Vec3
    velocity_ned_mps: Vec3
    heading_rad: float
    size_m: Vec3
    colour_bgr: Colour
    travelled_m: float = 0.0  # drives the gait of a walker


class Actor:
    """A moving object: a path, and a speed profile along it."""

    def __init__(
        self, name: str, kind: Kind, size_m: Vec3, colour_bgr: Colour, path: Path, profile: SpeedProfile
    ) -> None:
        self.name, self.kind, self.size_m, self.colour_bgr = name, kind, size_m, colour_bgr
        self.path, self._profile = path, profile

    def state(self, t_s: float) -> ObjectState:
        """The object at t_s."""
        speed, s_m = self._profile.at(min(t_s, PATH_HORIZON_S))
        if s_m > self.path.length_m or t_s > PATH_HORIZON_S:
            speed = 0.0
        pose = self.path.at(s_m)
        velocity = (speed * math.cos(pose.heading_rad), speed * math.sin(pose.heading_rad), 0.0)
        return ObjectState(
            self.name,
            self.kind,
            (pose.north_m, pose.east_m, 0.0),
            velocity,
            pose.heading_rad,
            self.size_m,
            self.colour_bgr,
            s_m,
        )


@dataclass(frozen=True, slots=True)
class Road:
    """A strip of asphalt along points (north, east) in metres."""

    points_m: tuple[tuple[float, float], ...]
    width_m: float


@dataclass(frozen=True, slots=True)
class World:
    """Everything there is to see: the first actor is the target.

    seed: of the ground's texture and the trees' shapes. All of it is fixed at construction, so that
    `state(t_s)` is a pure function.
    """

    seed: int
    actors: tuple[Actor, ...]
    props: tuple[ObjectState, ...]
    roads: tuple[Road, ...]

    def __post_init__(self) -> None:
        if not self.actors:
            raise ValueError("world: needs at least one actor, the target")

    @property
    def target_name(self) -> str:
        """The name of the object to be followed."""
        return self.actors[0].name

    def target(self, t_s: float) -> ObjectState:
        """The target at t_s (scenario seconds)."""
        return self.actors[0].state(t_s)

    def state(self, t_s: float) -> tuple[ObjectState, ...]:
        """All objects at t_s (scenario seconds): actors first, then props."""
        return tuple(actor.state(t_s) for actor in self.actors) + self.props
