"""The mocked world of a scenario as a target that moves, and as boxes in a camera's picture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl_mocks.lens import Lens, View
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import Pose
from sitl_mocks.world import Kind, ObjectState, World
from tracker.box import Box

Spans = tuple[tuple[float, float], ...]
_NEAREST_M = 0.3
_CORNERS = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-1.0, 0.0)])


class Stage:
    """The world's clock stands at start_s until `begin`. covered: scenario times in which nothing shows the target."""

    def __init__(self, world: World, start_s: float = 0.0, covered: Spans = ()) -> None:
        self.world = world
        self.t_s = self._start_s = start_s
        self._covered = covered
        self._begun_s: float | None = None
        self.target = world.target(start_s)

    def begin(self, now_s: float) -> None:
        """From now on it moves."""
        self._begun_s = now_s

    def step(self, now_s: float) -> None:
        """Be where all is at now_s."""
        if self._begun_s is not None:
            self.t_s = self._start_s + now_s - self._begun_s
        self.target = self.world.target(self.t_s)

    @property
    def position_ned_m(self) -> Vec3:
        """The target's middle."""
        north, east, down = self.target.position_ned_m
        return north, east, down - self.target.size_m[2] / 2

    @property
    def is_covered(self) -> bool:
        """Something that is not in the world is between."""
        return any(start_s <= self.t_s < end_s for start_s, end_s in self._covered)


@dataclass(frozen=True, slots=True)
class Outline:
    """All of an object in a picture, also where it is hidden or beyond the frame."""

    name: str
    kind: Kind
    box: Box
    distance_m: float

    def is_in(self, lens: Lens) -> bool:
        """Whether its middle is in the picture."""
        return 0 < self.box.cx_px < lens.width_px and 0 < self.box.cy_px < lens.height_px


def outlines(objects: Sequence[ObjectState], pose: Pose, lens: Lens) -> list[Outline]:
    """The objects that are in front of the camera, nearest first."""
    eye = np.array(pose.position_ned_m)
    rotation = lens.camera_from_ned(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
    view = View(rotation, eye, lens.matrix)
    points = view.to_camera(np.concatenate([_corners(each, pose) for each in objects]))
    pixels = view.to_px(points).reshape(-1, 8, 2)
    depths = points[:, 2].reshape(-1, 8).min(axis=1)
    lows, highs = pixels.min(axis=1), pixels.max(axis=1)
    found = []
    for each, depth_m, (x0, y0), (x1, y1) in zip(objects, depths, lows, highs, strict=True):
        if depth_m > _NEAREST_M:
            box = Box(float(x0 + x1) / 2, float(y0 + y1) / 2, float(x1 - x0), float(y1 - y0))
            found.append(Outline(each.name, each.kind, box, math.dist(each.position_ned_m, pose.position_ned_m)))
    return sorted(found, key=lambda outline: outline.distance_m)


def _corners(each: ObjectState, pose: Pose) -> npt.NDArray[np.float64]:
    """(8, 3) NED metres; a person looks alike from all sides."""
    north, east, _ = each.position_ned_m
    heading_rad = each.heading_rad
    if each.kind is Kind.PERSON:
        heading_rad = math.atan2(east - pose.position_ned_m[1], north - pose.position_ned_m[0])
    length_m, width_m, height_m = each.size_m if each.kind is not Kind.PERSON else (0.0, *each.size_m[1:])
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    local = _CORNERS * (length_m, width_m, height_m)
    return np.asarray(local @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + each.position_ned_m)


def covered_frac(outline: Outline, others: Iterable[Outline]) -> float:
    """How much of it the one nearer object that hides most of it hides. A tree's box is mostly air, and hides none."""
    nearer = (o for o in others if o.distance_m < outline.distance_m and o.kind is not Kind.TREE)
    return max((overlap_frac(outline.box, o.box) for o in nearer), default=0.0)


def overlap_frac(box: Box, by: Box) -> float:
    """The share of the box's area that the other covers."""
    width_px = (box.w_px + by.w_px) / 2 - abs(box.cx_px - by.cx_px)
    height_px = (box.h_px + by.h_px) / 2 - abs(box.cy_px - by.cy_px)
    width_px, height_px = min(width_px, box.w_px, by.w_px), min(height_px, box.h_px, by.h_px)
    return max(width_px, 0.0) * max(height_px, 0.0) / max(box.w_px * box.h_px, 1e-9)
