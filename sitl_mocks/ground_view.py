"""The ground, the horizon's haze and the sky, as seen from one camera pose."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.ground import DETAIL_PX, DETAIL_RES_M, LEVELS, MAP_PX, MAP_RES_M, Ground
from sitl_mocks.lens import View

Image = npt.NDArray[np.uint8]

MIN_HEIGHT_M = 0.25  # the camera of a landed vehicle
_HAZE_BGR, _ZENITH_BGR = (222, 208, 196), (214, 158, 112)
_HAZE_M = 420.0
_FLAT = 1e-3
_DETAIL_FADE = (150, 150, 170, 210, 330)  # divides the detail, by its level


def paint_ground(picture: Image, view: View, ground: Ground) -> None:
    """Fill the picture (H, W, 3) with ground and sky."""
    height_m = max(-float(view.position_ned_m[2]), MIN_HEIGHT_M)
    down = view.rotation[:, 2]  # the direction down, in the camera frame
    picture[:] = _HAZE_BGR
    rows = picture.shape[0]
    slope = _down_per_row(view, down, rows, picture.shape[1] / 2)
    wide = abs(float(down[0])) * picture.shape[1] / 2 / float(view.matrix[0, 0])
    levels = np.where(slope + wide > _FLAT, _level_per_row(view, slope, height_m), -1)
    edges = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), rows]
    for first, last in pairwise(edges):
        if levels[first] >= 0:
            _paint_band(picture, view, ground, int(levels[first]), first, last)
    _paint_sky(picture, view, down, height_m)


def _down_per_row(view: View, down: npt.NDArray[np.float64], rows: int, u_px: float) -> npt.NDArray[np.float64]:
    """For each row, the downward part of its middle pixel's ray (of unit depth); negative above the horizon."""
    f, cx, cy = view.matrix[0, 0], view.matrix[0, 2], view.matrix[1, 2]
    v = np.arange(rows)
    return np.asarray(down[0] * (u_px - cx) / f + down[1] * (v - cy) / f + down[2])


def _level_per_row(view: View, slope: npt.NDArray[np.float64], height_m: float) -> npt.NDArray[np.int64]:
    """The mip level that fits each row: between the footprint's short and long side."""
    safe = np.maximum(slope, 0.004)
    short_m = height_m / safe / float(view.matrix[0, 0])
    long_m = short_m / np.minimum(safe, 1.0)
    level = np.log2(np.sqrt(short_m * long_m) / MAP_RES_M) + 0.2
    return np.clip(np.round(level), 0, LEVELS - 1).astype(np.int64)


def _homography(view: View, res_m: float, size_px: int, row: int) -> npt.NDArray[np.float64]:
    """Texture px (column east, row south, repeating) to picture px counted from `row`."""
    north, east, down = (float(x) for x in view.position_ned_m)
    period_m = res_m * size_px
    # The texture repeats, so the camera may be moved by whole periods: small numbers keep their precision.
    north -= period_m * round(north / period_m)
    east -= period_m * round(east / period_m)
    origin = (size_px / 2 - 0.5) * res_m
    plane = np.array(
        [[0.0, -res_m, origin - north], [res_m, 0.0, -origin - east], [0.0, 0.0, max(-down, MIN_HEIGHT_M)]]
    )
    shift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -row], [0.0, 0.0, 1.0]])
    return np.asarray(shift @ view.matrix @ view.rotation @ plane)


def _warp(texture: Image, homography: npt.NDArray[np.float64], size: tuple[int, int]) -> Image:
    flags = cv2.INTER_LINEAR
    return np.asarray(cv2.warpPerspective(texture, homography, size, flags=flags, borderMode=cv2.BORDER_WRAP), np.uint8)


def _paint_band(picture: Image, view: View, ground: Ground, level: int, first: int, last: int) -> None:
    """Rows first..last from one mip level: the map, times the detail where that is coarse enough to see."""
    size = (picture.shape[1], last - first)
    res_m = MAP_RES_M * 2**level
    band = _warp(ground.map_levels[level], _homography(view, res_m, MAP_PX >> level, first), size)
    colour = cv2.cvtColor(band, cv2.COLOR_BGRA2BGR)
    fine = level + 1 if level else 0
    if fine < LEVELS - 2:
        detail_res_m = DETAIL_RES_M * 2**fine
        homography = _homography(view, detail_res_m, DETAIL_PX >> fine, first)
        detail = _warp(ground.detail_levels[fine], homography, size)
        strength = cv2.extractChannel(band, 3)
        lighter = cv2.multiply(detail, strength, scale=1 / _DETAIL_FADE[fine])
        neutral = cv2.convertScaleAbs(strength, alpha=128 / _DETAIL_FADE[fine])
        colour = cv2.add(colour, cv2.cvtColor(lighter, cv2.COLOR_GRAY2BGR))
        colour = cv2.subtract(colour, cv2.cvtColor(neutral, cv2.COLOR_GRAY2BGR))
    picture[first:last] = colour


def _paint_sky(picture: Image, view: View, down: npt.NDArray[np.float64], height_m: float) -> None:
    """Haze over distant ground and the sky above the horizon, on the rows that need it."""
    rows, columns = picture.shape[:2]
    f, cx, cy = view.matrix[0, 0], view.matrix[0, 2], view.matrix[1, 2]
    across = (down[0] * (np.arange(columns) - cx) / f).astype(np.float32)
    along = (down[1] * (np.arange(rows) - cy) / f + down[2]).astype(np.float32)
    clear = height_m / (0.04 * _HAZE_M)  # nearer than this the haze is under 4 %
    hazy = np.flatnonzero(along + across.min() < clear)
    if not len(hazy):
        return
    part = np.s_[hazy[0] : hazy[-1] + 1]
    ramp = along[part, None] + across[None]
    weight = 1 - np.exp(np.float32(-height_m / _HAZE_M) / np.maximum(ramp, np.float32(_FLAT)))
    up = np.clip(-ramp * np.float32(1.6), 0, 1)
    sky = np.empty((*ramp.shape, 3), np.uint8)
    for i in range(3):
        sky[..., i] = _HAZE_BGR[i] + (_ZENITH_BGR[i] - _HAZE_BGR[i]) * up
    picture[part] = cv2.blendLinear(picture[part], sky, 1 - weight, weight)
