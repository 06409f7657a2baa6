"""Affine placing of pictures and cut-out objects into patches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tracker.train import photometric
from tracker.train.pack import Imagery, Thing


def context_px(w: float, h: float) -> float:
    """Side of the square that a 127 px patch shows: sqrt((w+p)(h+p)), p = (w+h)/2."""
    p = (w + h) / 2
    return math.sqrt((w + p) * (h + p))


def thing_centre(thing: Thing) -> tuple[float, float]:
    """Centre of the thing's box in its picture, px."""
    x, y, w, h = thing.box
    return x + w / 2, y + h / 2


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the anchor of a picture lies in a patch (x, y px), its scales (patch px per picture px) and turn.

    anchor_x, anchor_y: the picture's point that goes to (x, y), px of the picture.
    """

    x: float
    y: float
    scale_x: float
    scale_y: float
    angle_rad: float
    shear: float
    flip: bool
    anchor_x: float = 0.0
    anchor_y: float = 0.0

    def about(self, anchor_x: float, anchor_y: float) -> Pose:
        """The same pose of another point of the picture."""
        return replace(self, anchor_x=anchor_x, anchor_y=anchor_y)

    def moved(self, dx: float, dy: float, zoom: float = 1.0, turn_rad: float = 0.0) -> Pose:
        """Shifted in the patch, zoomed and turned about its anchor."""
        return replace(
            self,
            x=self.x + dx,
            y=self.y + dy,
            scale_x=self.scale_x * zoom,
            scale_y=self.scale_y * zoom,
            angle_rad=self.angle_rad + turn_rad,
        )

    def towards(self, other: Pose, t: float) -> Pose:
        """The pose at share t of the way to the other."""

        def mix(a: float, b: float) -> float:
            return a + (b - a) * t

        return replace(
            self,
            x=mix(self.x, other.x),
            y=mix(self.y, other.y),
            scale_x=mix(self.scale_x, other.scale_x),
            scale_y=mix(self.scale_y, other.scale_y),
            angle_rad=mix(self.angle_rad, other.angle_rad),
        )

    def linear(self) -> np.ndarray:
        """(2,2): turn x shear x scale x flip."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turn = np.array([[c, -s], [s, c]])
        shape = np.array([[self.scale_x * (-1 if self.flip else 1), self.shear * self.scale_y], [0, self.scale_y]])
        return turn @ shape

    def matrix(self, level: float = 1.0) -> np.ndarray:
        """(2,3) affine from a picture shrunk by `level` to the patch."""
        a = self.linear()
        offset = np.array([self.x, self.y]) - a @ np.array([self.anchor_x, self.anchor_y])
        # cv2.resize keeps pixel corners, so a shrunk picture's centres shift by half a pixel
        half = (level - 1) / 2
        return np.hstack([a * level, (a @ np.array([half, half]) + offset)[:, None]])

    def box_of(self, cutter: CutOut) -> tuple[float, float, float, float]:
        """x1, y1, x2, y2 in patch px of the cut-out placed so."""
        points = (cutter.hull - [cutter.cx, cutter.cy]) @ (self.linear().T / cutter.shrink)
        (x1, y1), (x2, y2) = points.min(0), points.max(0)
        return self.x + x1, self.y + y1, self.x + x2, self.y + y2


@dataclass(frozen=True)
class CutOut:
    """An object with its soft mask: picture (h,w,3), alpha (h,w) uint8, hull (N,2) and box centre in its px.

    w, h: box size in px of the picture it came from, of which this one is shrunk by `shrink`.
    """

    picture: np.ndarray
    alpha: np.ndarray
    hull: np.ndarray
    cx: float
    cy: float
    w: float
    h: float
    shrink: float

    def recoloured(self, rng: np.random.Generator) -> CutOut:
        """The same shape in another light and colour: a hard rival."""
        picture = photometric.tone(self.picture, rng, 2.5)
        return replace(self, picture=np.ascontiguousarray(picture[:, :, rng.permutation(3)]))

    def shadow(self, rng: np.random.Generator) -> CutOut:
        """Its silhouette as a see-through dark patch."""
        alpha = (self.alpha * rng.uniform(0.35, 0.85)).astype(np.uint8)
        return replace(self, picture=np.full_like(self.picture, int(rng.integers(0, 40))), alpha=alpha)


def level_for(pyramid: tuple[np.ndarray, ...], scale: float) -> tuple[np.ndarray, float]:
    """The pyramid's picture to shrink from, and how much smaller it is than the full one."""
    i = 0 if scale > 0.6 else 1 if scale > 0.3 else 2
    return pyramid[i], pyramid[0].shape[1] / pyramid[i].shape[1]


def warp_around(pyramid: tuple[np.ndarray, ...], pose: Pose, size_px: int) -> np.ndarray:
    """The picture seen through a square patch (size,size,3); what lies outside is mirrored."""
    picture, level = level_for(pyramid, math.sqrt(pose.scale_x * pose.scale_y))
    return cv2.warpAffine(
        picture,
        pose.matrix(level),
        (size_px, size_px),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT_101,
    )


def outline_mask(imagery: Imagery, thing: Thing, x0: int, y0: int, w: int, h: int) -> tuple[np.ndarray, np.ndarray]:
    """Alpha (h,w) uint8 and hull points (N,2), both relative to x0, y0."""
    alpha = np.zeros((h, w), np.uint8)
    if thing.outline:
        polygons = [p - [x0, y0] for p in thing.outline]
        cv2.fillPoly(alpha, [np.round(p).astype(np.int32) for p in polygons], 255)
        return alpha, np.concatenate(polygons)
    if thing.mask_of >= 0:
        alpha = ((imagery.masks[thing.mask_of][y0 : y0 + h, x0 : x0 + w] > 0) * 255).astype(np.uint8)
        ys, xs = np.nonzero(alpha[::2, ::2])
        if len(xs) > 8:
            hull = cv2.convexHull(np.stack([xs * 2, ys * 2], 1).astype(np.float32))[:, 0]
            return alpha, hull
    # nothing known of its shape: an ellipse-like disc with its corners mostly kept
    bx, by, bw, bh = thing.box
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    c, s = np.cos(t), np.sin(t)
    hull = np.stack(
        [
            bx + bw / 2 - x0 + bw / 2 * np.sign(c) * np.abs(c) ** 0.6,
            by + bh / 2 - y0 + bh / 2 * np.sign(s) * np.abs(s) ** 0.6,
        ],
        1,
    )
    cv2.fillPoly(alpha, [np.round(hull).astype(np.int32)], 255)
    return alpha, hull


def cut_out(imagery: Imagery, thing: Thing) -> CutOut:
    """The object with a soft edge, from the pyramid level nearest to the size it will have in a patch."""
    picture = imagery.pyramids[thing.image][0]
    x, y, w, h = thing.box
    x0, y0 = max(0, int(x) - 2), max(0, int(y) - 2)
    x1, y1 = min(picture.shape[1], math.ceil(x + w) + 2), min(picture.shape[0], math.ceil(y + h) + 2)
    alpha, hull = outline_mask(imagery, thing, x0, y0, x1 - x0, y1 - y0)
    crop = picture[y0:y1, x0:x1]
    shrink = min(1.0, 140 / max(w, h))
    if shrink < 0.75:  # no object is shown larger than this: less to warp, no aliasing
        crop = cv2.resize(crop, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        alpha = cv2.resize(alpha, (crop.shape[1], crop.shape[0]), interpolation=cv2.INTER_AREA)
    else:
        shrink = 1.0
    alpha = cv2.blur(alpha, (3, 3))
    cx, cy = (x + w / 2 - x0) * shrink, (y + h / 2 - y0) * shrink
    return CutOut(crop, alpha, hull * shrink, cx, cy, w, h, shrink)


def paste(patch: np.ndarray, cutter: CutOut, pose: Pose) -> None:
    """Blend the cut-out into the patch, in place; pose scales are per px of the thing's own picture."""
    x1, y1, x2, y2 = pose.box_of(cutter)
    left, top = max(0, int(x1) - 3), max(0, int(y1) - 3)
    right, bottom = min(patch.shape[1], math.ceil(x2) + 4), min(patch.shape[0], math.ceil(y2) + 4)
    if right <= left or bottom <= top:
        return
    matrix = pose.about(cutter.cx, cutter.cy).moved(-left, -top, 1 / cutter.shrink).matrix()
    size = (right - left, bottom - top)
    picture = cv2.warpAffine(cutter.picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    alpha = cv2.warpAffine(cutter.alpha, matrix, size, flags=cv2.INTER_LINEAR)
    region = patch[top:bottom, left:right]
    a = alpha.astype(np.uint16)[:, :, None]
    region[:] = ((picture * a + region * (255 - a) + 127) // 255).astype(np.uint8)
