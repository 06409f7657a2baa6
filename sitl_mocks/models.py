"""Shapes of the world's built objects as textured faces: cars, houses and blocks.

Local frame of a shape: x along the heading, y to the right, z up from its base, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.world import Colour, Kind, ObjectState, Vec3

Image = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float64]

SUN_UP = np.array([0.449, -0.367, 0.816])  # towards the sun: north, east, up; matches ground.SUN_SHADOW_NE
_GLASS, _TYRE, _CONCRETE, _PLASTER = (64, 56, 48), (30, 30, 30), (150, 156, 160), (176, 196, 208)


@dataclass(frozen=True, slots=True)
class Face:
    """A flat four-cornered piece. corners_m: (4, 3) local, as seen from outside from top-left clockwise."""

    corners_m: Points
    texture: Image


def to_ned(points_m: Points, item: ObjectState) -> Points:
    """(N, 3) local points to NED metres."""
    c, s = math.cos(item.heading_rad), math.sin(item.heading_rad)
    x, y, z = points_m[:, 0], points_m[:, 1], points_m[:, 2]
    return np.asarray(np.stack([x * c - y * s, x * s + y * c, -z], axis=1) + np.array(item.position_ned_m))


def sun_shade(corners_ned_m: Points) -> float:
    """Brightness 0.5..1.15 of a face from its direction towards the sun."""
    normal = np.cross(corners_ned_m[1] - corners_ned_m[0], corners_ned_m[3] - corners_ned_m[0])
    # Seen from outside the corners run clockwise, so in NED (right-handed) this normal points inwards.
    outward = -normal / max(float(np.linalg.norm(normal)), 1e-9)
    lit = float(outward @ (SUN_UP * np.array([1, 1, -1])))
    return 0.62 + 0.5 * max(lit, 0.0) - 0.1 * max(-lit, 0.0)


class ModelLibrary:
    """Builds and keeps the faces of each kind, size and colour; textures are seeded."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._faces: dict[tuple[Kind, Vec3, Colour], list[Face]] = {}

    def faces(self, item: ObjectState) -> list[Face]:
        """The faces of a car, block or house, outside face order irrelevant (shapes are cut back by facing)."""
        key = (item.kind, item.size_m, item.colour_bgr)
        if key not in self._faces:
            rng = np.random.default_rng(self._seed)
            build = _car if item.kind is Kind.CAR else _house if item.kind is Kind.HOUSE else _block
            self._faces[key] = build(rng, item.size_m, item.colour_bgr)
        return self._faces[key]


def _panel(rng: np.random.Generator, w: int, h: int, colour: Colour, grain: float, gloss: float) -> Image:
    """A painted panel: a vertical gloss gradient and fine grain."""
    fall = np.linspace(1 + gloss, 1 - gloss, h, dtype=np.float32)[:, None, None]
    picture = np.array(colour, np.float32)[None, None] * fall
    picture = picture + rng.normal(0, grain, (h, w, 1)).astype(np.float32)
    return np.clip(np.broadcast_to(picture, (h, w, 3)), 0, 255).astype(np.uint8)


def _quad(*corners: Vec3) -> Points:
    return np.array(corners, np.float64)


def _box_faces(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> dict[str, Points]:
    (x0, x1), (y0, y1), (z0, z1) = x, y, z
    return {
        "back": _quad((x0, y0, z1), (x0, y1, z1), (x0, y1, z0), (x0, y0, z0)),
        "front": _quad((x1, y1, z1), (x1, y0, z1), (x1, y0, z0), (x1, y1, z0)),
        "left": _quad((x1, y0, z1), (x0, y0, z1), (x0, y0, z0), (x1, y0, z0)),
        "right": _quad((x0, y1, z1), (x1, y1, z1), (x1, y1, z0), (x0, y1, z0)),
        "top": _quad((x1, y0, z1), (x1, y1, z1), (x0, y1, z1), (x0, y0, z1)),
    }


def _car(rng: np.random.Generator, size_m: Vec3, colour: Colour) -> list[Face]:
    length, width, height = size_m
    waist = 0.56 * height
    half_l, half_w = length / 2, width / 2
    body = _box_faces((-half_l, half_l), (-half_w, half_w), (0.0, waist))
    side = _car_side(rng, colour)
    faces = [
        Face(body["back"], _car_end(rng, colour, (40, 40, 200))),
        Face(body["front"], _car_end(rng, colour, (235, 240, 240))),
        Face(body["left"], side),
        Face(body["right"], np.ascontiguousarray(side[:, ::-1])),
        Face(body["top"], _car_top(rng, colour)),
    ]
    return faces + _cabin(rng, length, half_w, waist, height, colour)


def _cabin(
    rng: np.random.Generator, length: float, half_w: float, low: float, high: float, colour: Colour
) -> list[Face]:
    """The glass house: a prism that narrows to the roof."""
    xb, xf, rb, rf = -0.42 * length, 0.21 * length, -0.31 * length, 0.05 * length
    wb, wr = 0.94 * half_w, 0.74 * half_w
    bl, br = (xb, -wb, low), (xb, wb, low)
    fl, fr = (xf, -wb, low), (xf, wb, low)
    tbl, tbr, tfl, tfr = (rb, -wr, high), (rb, wr, high), (rf, -wr, high), (rf, wr, high)
    windows = _car_windows(rng, colour)
    glass = _glass(rng, colour)
    return [
        Face(_quad(tbl, tbr, br, bl), glass),
        Face(_quad(tfr, tfl, fl, fr), glass),
        Face(_quad(tfl, tbl, bl, fl), windows),
        Face(_quad(tbr, tfr, fr, br), np.ascontiguousarray(windows[:, ::-1])),
        Face(_quad(tfl, tfr, tbr, tbl), _roof(rng, colour)),
    ]


def darker(colour: Colour, by: float) -> Colour:
    return (int(colour[0] * by), int(colour[1] * by), int(colour[2] * by))


def _car_side(rng: np.random.Generator, colour: Colour) -> Image:
    """The left side, front to the left: doors, sill, wheels."""
    picture = _panel(rng, 160, 36, colour, 3, 0.12)
    picture[13:15] = darker(colour, 0.82)
    for x in (62, 96, 126):
        picture[2:27, x] = darker(colour, 0.55)
    for x in (90, 120):
        picture[9:11, x : x + 5] = darker(colour, 0.5)
    picture[28:] = (24, 24, 24)
    for x in (29, 130):
        cv2.circle(picture, (x, 24), 13, (18, 18, 18), -1)
        cv2.circle(picture, (x, 24), 11, _TYRE, -1)
        cv2.circle(picture, (x, 24), 7, (150, 150, 152), -1)
        cv2.circle(picture, (x, 24), 3, (70, 70, 72), -1)
    return picture


def _car_end(rng: np.random.Generator, colour: Colour, lamp: Colour) -> Image:
    picture = _panel(rng, 72, 36, colour, 3, 0.12)
    for x in (3, 56):
        cv2.rectangle(picture, (x, 7), (x + 12, 13), lamp, -1)
    cv2.rectangle(picture, (25, 13), (47, 18), (225, 230, 230), -1)
    picture[21:27] = darker(colour, 0.7)
    picture[28:] = (26, 26, 26)
    return picture


def _car_top(rng: np.random.Generator, colour: Colour) -> Image:
    """Bonnet (top of the picture) and boot, seen from above."""
    picture = _panel(rng, 72, 160, colour, 3, 0.08)
    cv2.line(picture, (14, 4), (18, 44), darker(colour, 0.75), 1)
    cv2.line(picture, (57, 4), (53, 44), darker(colour, 0.75), 1)
    cv2.line(picture, (4, 46), (67, 46), darker(colour, 0.5), 1)
    cv2.line(picture, (4, 149), (67, 149), darker(colour, 0.6), 1)
    picture[:2] = darker(colour, 0.8)
    return cv2.GaussianBlur(picture, (3, 3), 0).astype(np.uint8)


def _roof(rng: np.random.Generator, colour: Colour) -> Image:
    picture = _panel(rng, 48, 56, colour, 3, 0.1)
    picture[:, 3:5] = darker(colour, 0.7)
    picture[:, 43:45] = darker(colour, 0.7)
    cv2.line(picture, (23, 50), (23, 54), (40, 40, 40), 2)
    return picture


def _glass(rng: np.random.Generator, colour: Colour) -> Image:
    picture = _panel(rng, 64, 30, _GLASS, 2, 0.35)
    cv2.fillConvexPoly(picture, np.array([[14, 0], [26, 0], [16, 30], [4, 30]]), (120, 112, 104))
    picture[:, :4] = colour
    picture[:, -4:] = colour
    return cv2.GaussianBlur(picture, (3, 3), 0).astype(np.uint8)


def _car_windows(rng: np.random.Generator, colour: Colour) -> Image:
    picture = _panel(rng, 96, 24, _GLASS, 2, 0.35)
    for x in (0, 44, 70, 91):
        picture[:, x : x + 5] = colour
    picture[:2] = colour
    return picture


def _block(rng: np.random.Generator, size_m: Vec3, colour: Colour) -> list[Face]:
    length, width, height = size_m
    faces = _box_faces((-length / 2, length / 2), (-width / 2, width / 2), (0.0, height))
    # A deck is seen from below as well when the vehicle stands on the ground.
    faces["bottom"] = faces["top"][::-1] * np.array([1, 1, 0])
    sizes = {"left": length, "right": length, "front": width, "back": width, "top": width, "bottom": width}
    out = []
    for name, corners in faces.items():
        tall = length if name in ("top", "bottom") else height
        out.append(Face(corners, _concrete(rng, sizes[name], tall, colour)))
    return out


def _concrete(rng: np.random.Generator, w_m: float, h_m: float, colour: Colour) -> Image:
    w, h = (int(np.clip(m * 14, 8, 400)) for m in (w_m, h_m))
    stains = cv2.resize(rng.normal(0, 1, (max(h // 9, 2), max(w // 9, 2))).astype(np.float32), (w, h))
    picture = np.array(colour, np.float32) + 11 * stains[..., None] + rng.normal(0, 6, (h, w, 1))
    out = np.clip(picture, 0, 255).astype(np.uint8)
    for x in range(0, w, 42):
        out[:, x : x + 1] = (out[:, x : x + 1] * 0.75).astype(np.uint8)
    out[:2] = (out[:2] * 0.8).astype(np.uint8)
    return out


def _house(rng: np.random.Generator, size_m: Vec3, colour: Colour) -> list[Face]:
    length, width, height = size_m
    eaves = 0.6 * height
    walls = _box_faces((-length / 2, length / 2), (-width / 2, width / 2), (0.0, eaves))
    x, y = length / 2 + 0.3, width / 2 + 0.3
    roof = _tiles(rng, colour)
    faces = [Face(walls[side], _wall(rng)) for side in ("left", "right", "front", "back")]
    rx, ry = 0.7 * x, 0.15  # the ridge, never a line: a face needs four corners
    bl, br, fl, fr = (-rx, -ry, height), (-rx, ry, height), (rx, -ry, height), (rx, ry, height)
    faces.append(Face(_quad(fl, bl, (-x, -y, eaves), (x, -y, eaves)), roof))
    faces.append(Face(_quad(br, fr, (x, y, eaves), (-x, y, eaves)), roof))
    faces.append(Face(_quad(bl, br, (-x, y, eaves), (-x, -y, eaves)), roof))
    faces.append(Face(_quad(fr, fl, (x, -y, eaves), (x, y, eaves)), roof))
    return [*faces, Face(_quad(fl, fr, br, bl), roof)]


def _wall(rng: np.random.Generator) -> Image:
    picture = _panel(rng, 120, 60, _PLASTER, 5, 0.04)
    for x in (14, 50, 86):
        cv2.rectangle(picture, (x, 16), (x + 20, 40), (236, 238, 240), -1)
        cv2.rectangle(picture, (x + 2, 18), (x + 18, 38), (72, 62, 54), -1)
        cv2.line(picture, (x + 10, 18), (x + 10, 38), (236, 238, 240), 1)
    return picture


def _tiles(rng: np.random.Generator, colour: Colour) -> Image:
    picture = _panel(rng, 120, 64, colour, 9, 0.06)
    picture[::5] = (picture[::5] * 0.75).astype(np.uint8)
    return picture
