"""The ground's picture: a seeded aerial-like map with roads, fields and shadows, and a fine detail tile.

Both repeat without a seam (the map every 384 m, the detail every 41 m) and come as mip levels, so that distant
ground does not shimmer.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.world import Kind, ObjectState, Road, World

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

MAP_PX = 3072
MAP_RES_M = 0.125
DETAIL_PX = 1024
DETAIL_RES_M = 0.04
SUN_SHADOW_NE = (-0.55, 0.45)  # metres of shadow (north, east) per metre of height
LEVELS = 7

_GRASS_DARK, _GRASS_LIGHT = (38, 72, 62), (74, 128, 122)
_DIRT, _CROP, _ASPHALT = (92, 126, 152), (78, 148, 158), (108, 107, 105)
_LINE = (205, 212, 214)
_MAP_M = MAP_PX * MAP_RES_M


class Ground:
    """Mip levels of the map (BGRA: alpha = strength of the detail) and of the detail (grey, 128 = neutral)."""

    def __init__(self, world: World) -> None:
        rng = np.random.default_rng(world.seed)
        picture = _paint_map(rng, world)
        self.map_levels = _mip_levels(picture)
        self.detail_levels = _mip_levels(_detail(rng))


def _mip_levels(picture: Image) -> list[Image]:
    levels = [picture]
    for _ in range(LEVELS - 1):
        last = levels[-1]
        half = (last.shape[1] // 2, last.shape[0] // 2)
        levels.append(np.asarray(cv2.resize(last, half, interpolation=cv2.INTER_AREA), np.uint8))
    return levels


def _noise(rng: np.random.Generator, size_px: int, cells: int) -> Floats:
    """One octave of noise that repeats without a seam, (size_px, size_px), about unit variance."""
    grid = rng.standard_normal((cells, cells), dtype=np.float32)
    grid = np.pad(grid, 2, mode="wrap")
    cell_px = size_px / cells
    big = cv2.resize(grid, None, fx=cell_px, fy=cell_px, interpolation=cv2.INTER_CUBIC)
    off = round(2 * cell_px)
    return np.asarray(big[off : off + size_px, off : off + size_px], np.float32)


def _octaves(rng: np.random.Generator, cells: tuple[int, ...], fall: float) -> Floats:
    """Octaves summed at half the map's size (their finest cell is far wider than a texel), then enlarged."""
    total = np.zeros((MAP_PX // 2, MAP_PX // 2), np.float32)
    for i, n in enumerate(cells):
        total += _noise(rng, MAP_PX // 2, n) * np.float32(fall**i)
    total /= np.float32(total.std())
    wrapped = np.pad(total, 2, mode="wrap")
    big = cv2.resize(wrapped, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    return np.asarray(big[4:-4, 4:-4], np.float32)


def _mix(base: Floats, colour: tuple[int, int, int], weight: Floats | float) -> None:
    """Blend a colour into the picture in place; weight 0..1 of shape (H, W) or a number."""
    for channel in range(3):
        plane = base[..., channel]
        plane += (np.float32(colour[channel]) - plane) * weight


def _ramp(x: Floats, low: float, high: float) -> Floats:
    return np.asarray(np.clip((x - np.float32(low)) / np.float32(high - low), 0, 1), np.float32)


def _paint_map(rng: np.random.Generator, world: World) -> Image:
    coarse = _octaves(rng, (6, 12, 24, 48), 0.7)
    fine = _octaves(rng, (48, 96, 192, 384, 768), 0.8)
    speckle = _noise(rng, MAP_PX, MAP_PX // 2)
    base = np.empty((MAP_PX, MAP_PX, 3), np.float32)
    base[:] = _GRASS_DARK
    _mix(base, _GRASS_LIGHT, np.clip(0.5 + 0.22 * coarse + 0.18 * fine, 0, 1))
    _mix(base, _DIRT, 0.8 * _ramp(0.6 * coarse + 0.8 * fine, 1.3, 1.9))
    detail = np.full((MAP_PX, MAP_PX), 120, np.float32)
    _paint_fields(rng, base)
    tint = 1 + 0.07 * fine + 0.05 * speckle
    base *= tint[..., None]
    if world.roads:
        _paint_roads(base, detail, world.roads, tint)
    _paint_shadows(base, world)
    picture = np.empty((MAP_PX, MAP_PX, 4), np.uint8)
    picture[..., :3] = np.clip(base, 0, 255)
    picture[..., 3] = detail
    return picture


def _to_px(points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(north, east) in metres to (column, row) of the map."""
    return np.stack([points_m[:, 1] / MAP_RES_M, -points_m[:, 0] / MAP_RES_M], axis=1) + MAP_PX / 2 - 0.5


def _copies(points_px: npt.NDArray[np.float64]) -> list[npt.NDArray[np.int32]]:
    """The polyline in 1/16 px, once for each copy of the repeating map that it touches."""
    low = np.floor(points_px.min(axis=0) / MAP_PX).astype(int) - 1
    high = np.floor(points_px.max(axis=0) / MAP_PX).astype(int) + 1
    return [
        np.round((points_px - np.array([i, j]) * MAP_PX) * 16).astype(np.int32)
        for i in range(low[0], high[0] + 1)
        for j in range(low[1], high[1] + 1)
    ]


def _paint_fields(rng: np.random.Generator, base: Floats) -> None:
    """Ploughed and cropped rectangles with rows, kept off the middle of the map's roads by being painted first."""
    mask = np.zeros((MAP_PX, MAP_PX), np.uint8)
    for _ in range(14):
        mask[:] = 0
        centre, angle = rng.uniform(200, MAP_PX - 200, 2), float(rng.uniform(0, 180))
        size = rng.uniform(250, 620, 2)
        corners = cv2.boxPoints(((float(centre[0]), float(centre[1])), (float(size[0]), float(size[1])), angle))
        cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 255)
        x, y, w, h = cv2.boundingRect(np.round(corners).astype(np.int32))
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, MAP_PX), min(y + h, MAP_PX)
        part = np.s_[y0:y1, x0:x1]
        turn = math.radians(angle)
        xs, ys = np.arange(x0, x1, dtype=np.float32), np.arange(y0, y1, dtype=np.float32)
        across = xs[None] * np.float32(math.cos(turn)) + ys[:, None] * np.float32(math.sin(turn))
        rows = 0.5 + 0.5 * np.sin(across * np.float32(2 * math.pi / rng.uniform(8, 20)))
        weight = cv2.GaussianBlur(mask[part], (0, 0), 4).astype(np.float32) / 255
        colour = _CROP if rng.random() < 0.5 else _DIRT
        _mix(base[part], colour, weight * (0.25 + 0.4 * rows.astype(np.float32)))


def _draw(mask: Image, points_m: npt.NDArray[np.float64], width_m: float) -> None:
    """A polyline of the given width into a mask, in every copy of the repeating map."""
    thickness = max(1, round(width_m / MAP_RES_M))
    cv2.polylines(mask, _copies(_to_px(points_m)), False, 255, thickness, cv2.LINE_AA, 4)


def _weight(mask: Image, strength: float) -> Floats:
    return mask.astype(np.float32) * np.float32(strength / 255)


def _offset(points_m: npt.NDArray[np.float64], right_m: float) -> npt.NDArray[np.float64]:
    """The polyline moved to its right by right_m."""
    along = np.gradient(points_m, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return points_m + right_m * np.stack([-along[:, 1], along[:, 0]], axis=1)


def _paint_roads(base: Floats, detail: Floats, roads: tuple[Road, ...], tint: Floats) -> None:
    """Dirt verges, asphalt, darker wheel tracks, edge lines and the dashed centre line of all roads."""
    verge, surface, tracks, lines = (np.zeros((MAP_PX, MAP_PX), np.uint8) for _ in range(4))
    for road in roads:
        points = np.array(road.points_m, np.float64)
        _draw(verge, points, road.width_m + 1.6)
        _draw(surface, points, road.width_m)
        for side in (-1, 1):
            for wheel in (-0.75, 0.75):
                _draw(tracks, _offset(points, side * road.width_m / 4 + wheel), 0.6)
            _draw(lines, _offset(points, side * (road.width_m / 2 - 0.35)), 0.2)
        _draw_dashes(lines, points)
    _mix(base, _DIRT, _weight(np.asarray(cv2.blur(verge, (9, 9)), np.uint8), 0.6))
    covered = _weight(surface, 1.0)
    _mix(base, _ASPHALT, covered)
    base *= (1 + covered * (0.7 * (tint - 1)) - _weight(tracks, 0.09))[..., None]
    _mix(base, _LINE, _weight(lines, 0.8))
    detail += (38 - detail) * covered


def _draw_dashes(mask: Image, points_m: npt.NDArray[np.float64]) -> None:
    """The centre line: 3 m of paint every 7.5 m."""
    steps = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    for start in np.arange(0.0, along[-1] - 3.0, 7.5):
        s = np.linspace(start, start + 3.0, 5)
        _draw(mask, np.stack([np.interp(s, along, points_m[:, i]) for i in (0, 1)], axis=1), MAP_RES_M)


def _paint_shadows(base: Floats, world: World) -> None:
    """Shadows of everything that stands still; moving objects cast theirs when drawn."""
    mask = np.zeros((MAP_PX, MAP_PX), np.uint8)
    for prop in world.props:
        outline = np.round(_to_px(shadow_outline_m(prop))).astype(np.int32)
        cv2.fillConvexPoly(mask, outline, 255)
    shade = _weight(np.asarray(cv2.GaussianBlur(mask, (0, 0), 1.5), np.uint8), 1.0)
    for channel, dark in enumerate((0.42, 0.5, 0.53)):  # shadows are bluish: the sky still lights them
        base[..., channel] *= 1 - np.float32(dark) * shade


def shadow_outline_m(item: ObjectState) -> npt.NDArray[np.float64]:
    """The convex outline (N, 2) in (north, east) metres of the shadow that an object casts on the ground."""
    length, width, height = item.size_m
    bottom = -item.position_ned_m[2]
    if item.kind is Kind.TREE:
        angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        crown = 0.42 * width * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        stack = [crown + np.array(SUN_SHADOW_NE) * z for z in (0.45 * height, 0.85 * height)]
    else:
        c, s = math.cos(item.heading_rad), math.sin(item.heading_rad)
        corners = np.array([(length, width), (length, -width), (-length, -width), (-length, width)]) / 2
        corners = corners @ np.array([[c, s], [-s, c]])
        stack = [corners + np.array(SUN_SHADOW_NE) * z for z in (bottom, bottom + height)]
    points = np.concatenate(stack) + np.array(item.position_ned_m[:2])
    hull = cv2.convexHull(points.astype(np.float32))
    return np.asarray(hull, np.float64).reshape(-1, 2)


def _detail(rng: np.random.Generator) -> Image:
    """Grass blades, tufts and stones at 4 cm, repeating without a seam."""
    white = rng.standard_normal((DETAIL_PX, DETAIL_PX)).astype(np.float32)
    total = np.zeros_like(white)
    for sigma, weight in ((0.6, 0.6), (1.6, 0.7), (4.0, 0.45), (10.0, 0.25)):
        pad = 40
        wide = cv2.GaussianBlur(np.pad(white, pad, mode="wrap"), (0, 0), sigma)[pad:-pad, pad:-pad]
        total += weight * wide / wide.std()
        white = np.roll(white, (311, 173), axis=(0, 1))
    return np.clip(128 + 25 * total, 0, 255).astype(np.uint8)
