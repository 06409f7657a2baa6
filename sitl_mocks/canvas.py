"""A finer cut-out of the picture that one object is drawn into, then averaged down: smooth at any size."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

_SHIFT = 4  # fractional bits of OpenCV's drawing


@dataclass(frozen=True, slots=True)
class Silhouette:
    """What one object covers. box: x, y, w, h in pinhole px, not cut at the frame.

    mask: 0..255 coverage at 1 px per cell whose top-left cell is at (left, top); the frame cuts it.
    area_px: of the whole silhouette, also outside the frame.
    outline_px: the points that span the box, (N, 2).
    """

    outline_px: Array
    left: int
    top: int
    mask: Image
    area_px: float


class Canvas:
    """Colour and coverage at two or three times the picture's resolution, once for large objects."""

    def __init__(self, left: int, top: int, width: int, height: int, detail: int) -> None:
        self._left, self._top, self._detail = left, top, detail
        self._colour = np.zeros((height * detail, width * detail, 3), np.uint8)
        self._cover = np.zeros((height * detail, width * detail), np.uint8)

    @classmethod
    def around(cls, points_px: Array, picture: Image, detail: int | None = None) -> Canvas | None:
        """Round the points, cut at the frame; None when all of it is outside."""
        rows, columns = picture.shape[:2]
        low, high = np.floor(points_px.min(axis=0)) - 2, np.ceil(points_px.max(axis=0)) + 3
        x0, y0 = max(int(low[0]), 0), max(int(low[1]), 0)
        x1, y1 = min(int(high[0]), columns), min(int(high[1]), rows)
        if x0 >= x1 or y0 >= y1:
            return None
        size = max(x1 - x0, y1 - y0)
        return cls(x0, y0, x1 - x0, y1 - y0, detail or (3 if size < 130 else 2 if size < 300 else 1))

    def _local(self, points_px: Array) -> Array:
        # Pixel centres are at whole numbers in both grids.
        return np.asarray((points_px - np.array([self._left, self._top]) + 0.5) * self._detail - 0.5)

    def flat(self, polygon_px: Array, colour: Array) -> None:
        """A convex polygon of one colour."""
        points = np.round(np.clip(self._local(polygon_px), -30000, 30000) * 2**_SHIFT).astype(np.int32)
        cv2.fillConvexPoly(self._colour, points, [float(c) for c in colour], cv2.LINE_8, _SHIFT)
        cv2.fillConvexPoly(self._cover, points, 255, cv2.LINE_8, _SHIFT)

    def face(self, polygon_px: Array, texture: Image) -> None:
        """A four-cornered polygon with a texture."""
        self.flat(polygon_px, texture.reshape(-1, 3).mean(axis=0))
        self._warp(self._local(polygon_px), texture, self._colour, cv2.BORDER_TRANSPARENT)

    def sprite(self, polygon_px: Array, texture: Image) -> None:
        """A texture with its own coverage (BGRA) as the only thing on the canvas."""
        out = np.zeros((*self._cover.shape, 4), np.uint8)
        self._warp(self._local(polygon_px), texture, out, cv2.BORDER_CONSTANT)
        self._colour, self._cover = out[..., :3].copy(), out[..., 3].copy()

    def _warp(self, corners: Array, texture: Image, out: Image, border: int) -> None:
        h, w = texture.shape[:2]
        source = np.array([(-0.5, -0.5), (w - 0.5, -0.5), (w - 0.5, h - 0.5), (-0.5, h - 0.5)], np.float32)
        homography = cv2.getPerspectiveTransform(source, corners.astype(np.float32))
        cv2.warpPerspective(texture, homography, out.shape[1::-1], out, cv2.INTER_LINEAR, border)

    def capsule(self, ends_px: Array, radii_px: tuple[float, float], colour: tuple[int, int, int]) -> None:
        """A limb: dark at the rim, lit from the upper left."""
        ends, radii = self._local(ends_px), np.array(radii_px) * self._detail
        for shade, grow, shift in ((0.62, 1.0, 0.0), (0.9, 0.78, 0.18), (1.12, 0.45, 0.34)):
            centres = ends - np.outer(radii, [0.7, 0.5]) * shift
            ring = np.concatenate([_circle(c, max(r * grow, 0.5)) for c, r in zip(centres, radii, strict=True)])
            hull = cv2.convexHull(np.round(ring * 2**_SHIFT).astype(np.int32))
            cv2.fillConvexPoly(self._colour, hull, [min(255.0, c * shade) for c in colour], cv2.LINE_8, _SHIFT)
            if grow == 1.0:
                cv2.fillConvexPoly(self._cover, hull, 255, cv2.LINE_8, _SHIFT)

    def finish(self, picture: Image, outline_px: Array) -> Silhouette:
        """Lay the canvas over the picture; the silhouette it covers."""
        mask, colour = self._shrink()
        h, w = mask.shape
        part = picture[self._top : self._top + h, self._left : self._left + w]
        weight = mask.astype(np.float32) / 255
        part[:] = cv2.blendLinear(colour, part, weight, 1 - weight)
        inside = float(mask.sum(dtype=np.float64)) / 255
        return Silhouette(outline_px, self._left, self._top, mask, inside * self._uncut(outline_px, picture))

    def _uncut(self, outline_px: Array, picture: Image) -> float:
        """How much larger the silhouette is than its part inside the frame, by its convex hull."""
        rows, columns = picture.shape[:2]
        hull = np.asarray(cv2.convexHull(outline_px.astype(np.float32)), np.float32)
        frame = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)], np.float32) - 0.5
        whole = cv2.contourArea(hull)
        inside, _ = cv2.intersectConvexConvex(hull, frame)
        return max(whole / max(inside, 1e-3), 1.0) if whole > 0 else 1.0

    def darken(self, picture: Image, strength: float) -> None:
        """Use the coverage as a soft shadow."""
        mask, _ = self._shrink()
        h, w = mask.shape
        part = picture[self._top : self._top + h, self._left : self._left + w]
        weight = cv2.blur(mask, (3, 3)).astype(np.float32) * np.float32(strength / 255)
        part[:] = cv2.blendLinear(part, np.zeros_like(part), 1 - weight, weight)

    def _shrink(self) -> tuple[Image, Image]:
        h, w = self._cover.shape[0] // self._detail, self._cover.shape[1] // self._detail
        if self._detail == 1:
            return self._cover, self._colour
        # Only covered cells have a colour: average colour and coverage together, then divide.
        mask = cv2.resize(self._cover, (w, h), interpolation=cv2.INTER_AREA)
        colour = cv2.resize(self._colour, (w, h), interpolation=cv2.INTER_AREA)
        full = cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR)
        whole = cv2.divide(colour, full, scale=255.0)
        return np.asarray(mask, np.uint8), np.asarray(whole, np.uint8)


def _circle(centre: Array, radius: float) -> Array:
    angles = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    return np.asarray(centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
