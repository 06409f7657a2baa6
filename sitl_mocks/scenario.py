"""Scenarios: small JSON files that say what moves where, read into a World; and the clock they run on."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath

from sitl_mocks.scenario_fields import Fields, ScenarioError
from sitl_mocks.world import (
    PATH_HORIZON_S,
    Actor,
    Colour,
    Kind,
    ObjectState,
    Path,
    Pose,
    Road,
    Segment,
    SpeedProfile,
    Vec3,
    World,
)

_FOLDER = FilePath(__file__).parent / "scenarios"
__all__ = ["Scenario", "ScenarioClock", "ScenarioError", "load", "names"]

_COLOURS: dict[str, Colour] = {
    "red": (38, 36, 178),
    "white": (226, 230, 230),
    "blue": (150, 78, 36),
    "silver": (172, 170, 166),
    "black": (44, 40, 38),
    "yellow": (40, 180, 214),
    "green": (62, 110, 48),
    "orange": (36, 110, 226),
    "concrete": (150, 156, 160),
    "tiles": (60, 80, 150),
}
_SIZES: dict[Kind, Vec3] = {
    Kind.CAR: (4.3, 1.8, 1.45),
    Kind.PERSON: (0.5, 0.5, 1.78),
    Kind.TREE: (5.0, 5.0, 7.0),
    Kind.BLOCK: (1.0, 4.0, 3.0),
    Kind.HOUSE: (12.0, 8.0, 6.5),
}
_ROAD_STEP_M = 2.0
_ROAD_BACK_M = 40.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """A world with what a flight in it needs: hover height (m), vehicle heading (rad), useful length (s)."""

    name: str
    text: str
    world: World
    height_m: float
    heading_rad: float
    duration_s: float


def names() -> list[str]:
    """The scenarios that come with the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.json"))


def load(name: str, seed: int | None = None) -> Scenario:
    """A scenario by name or by the path of a JSON file; a seed replaces the file's. Raises ScenarioError."""
    path = FilePath(name) if name.endswith(".json") else _FOLDER / f"{name}.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ScenarioError(f"scenario {name!r} is not known; there are: {', '.join(names())}") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ScenarioError(f"scenario file {path}: {error}") from error
    try:
        return _scenario(path.stem, Fields(content, path.name), seed)
    except ValueError as error:
        raise ScenarioError(f"scenario file {path}: {error}") from error


def _scenario(name: str, fields: Fields, seed: int | None) -> Scenario:
    file_seed = round(fields.number("seed", 1))
    seed = file_seed if seed is None else seed
    roads: list[Road] = [Road(item.pairs("points_m"), item.number("width_m", 6.0)) for item in fields.objects("roads")]
    actors = []
    for item in fields.objects("actors"):
        actor, road = _actor(item)
        actors.append(actor)
        roads += [road] if road is not None else []
    props: list[ObjectState] = []
    for i, item in enumerate(fields.objects("props")):
        props += _prop(item, i, {actor.name: actor for actor in actors})
    props += _forest(fields.child("trees"), actors, props, seed)
    world = World(seed, tuple(actors), tuple(props), tuple(roads))
    scenario = Scenario(
        name,
        fields.text("text"),
        world,
        fields.number("height_m", 9.0),
        math.radians(fields.number("heading_deg", 0.0)),
        fields.number("duration_s", 90.0),
    )
    fields.done()
    return scenario


def _kind(fields: Fields) -> Kind:
    text = fields.text("kind")
    try:
        return Kind(text)
    except ValueError:
        raise ScenarioError(f"kind {text!r} is not one of {', '.join(k.value for k in Kind)}") from None


def _colour(fields: Fields, default: str) -> Colour:
    text = fields.text("colour", default)
    if text not in _COLOURS:
        raise ScenarioError(f"colour {text!r} is not one of {', '.join(_COLOURS)}")
    return _COLOURS[text]


def _size(fields: Fields, kind: Kind) -> Vec3:
    length, width, height = fields.numbers("size_m", 3, _SIZES[kind])
    if min(length, width, height) <= 0:
        raise ScenarioError("size_m: must be positive")
    return (length, width, height)


def _actor(fields: Fields) -> tuple[Actor, Road | None]:
    """An actor; with `road`, the asphalt it drives on (offset_m: of the road's middle, to the actor's right)."""
    name, kind = fields.text("name"), _kind(fields)
    north, east, heading = fields.numbers("start", 3)
    start = Pose(north, east, math.radians(heading))
    segments = tuple(_segment(item) for item in fields.objects("path"))
    profile = SpeedProfile(fields.pairs("speed") or ((0.0, 0.0),))
    _, length_m = profile.at(PATH_HORIZON_S)
    path = Path(start, segments, length_m)
    actor = Actor(name, kind, _size(fields, kind), _colour(fields, "red"), path, profile)
    strip = fields.child("road")
    road = None
    if strip is not None:
        road = _road_along(path, strip.number("offset_m", -1.75), strip.number("width_m", 7.0), strip.number("to_m"))
        strip.done()
    fields.done()
    return actor, road


def _segment(fields: Fields) -> Segment:
    """{"straight_m": 40} or {"turn_deg": 90, "radius_m": 20}; right turns are positive."""
    straight_m, turn, radius_m = (fields.number(k, 0.0) for k in ("straight_m", "turn_deg", "radius_m"))
    fields.done()
    if straight_m:
        return Segment(straight_m)
    return Segment(abs(math.radians(turn)) * radius_m, math.radians(turn))


def _aside(pose: Pose, right_m: float) -> tuple[float, float]:
    c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    return (pose.north_m - right_m * s, pose.east_m + right_m * c)


def _road_along(path: Path, offset_m: float, width_m: float, to_m: float) -> Road:
    """The road under the first to_m metres of a path, begun well behind its start."""
    first = path.at(0.0)
    back = Pose(
        first.north_m - _ROAD_BACK_M * math.cos(first.heading_rad),
        first.east_m - _ROAD_BACK_M * math.sin(first.heading_rad),
        first.heading_rad,
    )
    steps = int(min(to_m, path.length_m) / _ROAD_STEP_M)
    poses = [back, *(path.at(i * _ROAD_STEP_M) for i in range(steps + 1))]
    return Road(tuple(_aside(pose, offset_m) for pose in poses), width_m)


def _prop(fields: Fields, index: int, actors: dict[str, Actor]) -> list[ObjectState]:
    """Something that stands still: at `place` (north, east, heading), or `beside` an actor's path.

    beside: {"actor", "at_m", "right_m"}; base_m lifts it off the ground; `deck` adds piers below it.
    """
    kind = _kind(fields)
    size, colour = _size(fields, kind), _colour(fields, "tiles" if kind is Kind.HOUSE else "concrete")
    base_m, turn_deg = fields.number("base_m", 0.0), fields.number("turn_deg", 0.0)
    beside = fields.child("beside")
    if beside is None:
        north, east, heading_deg = fields.numbers("place", 3)
        heading = math.radians(heading_deg)
    else:
        name = beside.text("actor")
        if name not in actors:
            raise ScenarioError(f"props[{index}].beside: there is no actor {name!r}")
        pose = actors[name].path.at(beside.number("at_m"))
        north, east = _aside(pose, beside.number("right_m", 0.0))
        heading = pose.heading_rad
        beside.done()
    piers = fields.number("piers", 0.0)
    fields.done()
    heading += math.radians(turn_deg)
    still = (0.0, 0.0, 0.0)
    prop = ObjectState(f"{kind.value}{index}", kind, (north, east, -base_m), still, heading, size, colour)
    return [prop, *(_piers(prop, index) if piers else [])]


def _piers(deck: ObjectState, index: int) -> Iterator[ObjectState]:
    """Two supports at the ends of a bridge's span."""
    north, east, down = deck.position_ned_m
    for i, side in enumerate((-1, 1)):
        at = _aside(Pose(north, east, deck.heading_rad), side * (deck.size_m[1] / 2 - 1.2))
        size = (0.8 * deck.size_m[0], 0.9, -down)
        still = (0.0, 0.0, 0.0)
        yield ObjectState(f"pier{index}.{i}", Kind.BLOCK, (*at, 0.0), still, deck.heading_rad, size, deck.colour_bgr)


def _forest(fields: Fields | None, actors: list[Actor], props: list[ObjectState], seed: int) -> list[ObjectState]:
    """Trees scattered at random within reach_m of home, clear_m away from paths and other things."""
    if fields is None:
        return []
    count, reach_m, clear_m = round(fields.number("count")), fields.number("reach_m"), fields.number("clear_m")
    fields.done()
    taken = [(p.position_ned_m[0], p.position_ned_m[1]) for p in props]
    for actor in actors:
        for i in range(int(min(actor.path.length_m, 700.0) / 3) + 1):
            pose = actor.path.at(i * 3.0)
            taken.append((pose.north_m, pose.east_m))
    rng = random.Random(seed)
    trees: list[ObjectState] = []
    for _ in range(count * 20):
        place = (rng.uniform(-reach_m, reach_m), rng.uniform(-reach_m, reach_m))
        if len(trees) == count:
            break
        if min(math.dist(place, other) for other in taken) < clear_m:
            continue
        height, still = rng.uniform(4.5, 7.0), (0.0, 0.0, 0.0)
        size = (0.75 * height, 0.75 * height, height)
        trees.append(ObjectState(f"tree.{len(trees)}", Kind.TREE, (*place, 0.0), still, 0.0, size, (0, 0, 0)))
        taken.append(place)
    return trees


@dataclass(slots=True)
class ScenarioClock:
    """Scenario time, 0 until the vehicle has reached its height (steady for a second) and move_after_s more.

    speed: scenario seconds per second.
    """

    move_after_s: float = 0.0
    speed: float = 1.0
    _steady_since_s: float | None = None
    _start_s: float | None = None

    def update(self, now_s: float, height_m: float, climb_mps: float) -> float:
        """Scenario time (s) at now_s, from the vehicle's height above ground and climb rate."""
        if self._start_s is None:
            steady = height_m > 2.0 and abs(climb_mps) < 0.3
            if not steady:
                self._steady_since_s = None
            elif self._steady_since_s is None:
                self._steady_since_s = now_s
            elif now_s - self._steady_since_s >= 1.0:
                self._start_s = now_s + self.move_after_s
        return 0.0 if self._start_s is None else max(now_s - self._start_s, 0.0) * self.speed
