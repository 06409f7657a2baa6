"""What moves against the background between three pictures: boxes, without the shadows that move along. Pure.

The background is carried from picture to picture by a homography over its corners; what differs then from both earlier
pictures, by more than a pixel's shift can explain, has moved. About 15 ms on one core.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.video.frame import Image
from tracker.box import Box

_WIDTH_PX: Final = 480  # of the small copies
_MANY: Final = 2.6  # a copy more than so much smaller is first thinned out
_CORNERS: Final = 150
_FEWEST: Final = 12
_BACKGROUND_FRAC: Final = 0.4  # of the corners must move as one plane
_LEAST_GREY: Final = 12.0  # grey levels of difference that are more than noise, and compared with the picture's mean
_MEANS: Final = 4.0
_CLOSE: Final = np.ones((5, 5), np.uint8)
_SHIFT: Final = np.ones((3, 3), np.uint8)  # what the background may be misplaced
_LEAST_PX: Final = 4
_LARGEST_FRAC: Final = 0.08  # of the picture: more is no thing but a background that was not found
_GAP_PX, _GAP_FRAC = 2.0, 0.15  # parts nearer than this are one thing
_SHADE_LEAST, _SHADE_MOST, _SHADE_COLOUR = 0.25, 0.9, 0.12  # a shadow leaves so much light, alike in all colours
_SOLID_FRAC: Final = 0.2  # of what moves must be more than shadow, or it is one, or as dark as one
_SHADOW_WEIGHT: Final = 0.25

Mask = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Moving:
    """box in px of the full picture; weight: how much it differs, grey levels times pixels."""

    box: Box
    weight: float


def moving(earlier: list[Image], newest: Image) -> list[Moving]:
    """Boxes in the newest picture, those that differ most first. earlier: one or two of the same size, newest first."""
    now = _Small.of(newest)
    moved = [found for image in earlier if (found := now.changed_since(_Small.of(image))) is not None]
    if not moved:
        return []
    change = np.minimum.reduce([change for change, _ in moved])  # else a thing is also seen where it has been
    behind = np.maximum.reduce([image for _, image in moved])
    parts = _merged(_parts(change, now.image, behind))
    scale, area = newest.shape[1] / change.shape[1], change.size
    parts = [part for part in parts if part.w * part.h < _LARGEST_FRAC * area]
    return [part.moving(scale) for part in sorted(parts, key=lambda part: -part.weight)]


@dataclass(frozen=True, slots=True)
class _Small:
    image: Image
    grey: Mask

    @classmethod
    def of(cls, image_bgr: Image) -> _Small:
        height, width = image_bgr.shape[:2]
        if width > _MANY * _WIDTH_PX:
            image_bgr = image_bgr[::2, ::2]
        if width > _WIDTH_PX:
            size = _WIDTH_PX, max(1, round(height * _WIDTH_PX / width))
            image_bgr = np.asarray(cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
        image = np.asarray(cv2.GaussianBlur(image_bgr, (3, 3), 0), np.uint8)
        return cls(image, np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8))

    def changed_since(self, before: _Small) -> tuple[Mask, Image] | None:
        """The change in grey levels, and the picture before as it would stand here. None: no background found."""
        if self.grey.shape != before.grey.shape:
            return None
        onto = _background(before.grey, self.grey)
        if onto is None:
            return None
        size = self.grey.shape[1], self.grey.shape[0]
        image = np.asarray(cv2.warpPerspective(before.image, onto, size), np.uint8)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        brighter = cv2.subtract(self.grey, cv2.dilate(grey, _SHIFT))
        darker = cv2.subtract(cv2.erode(grey, _SHIFT), self.grey)
        change = np.asarray(np.maximum(brighter, darker), np.uint8)
        seen = cv2.warpPerspective(np.full_like(before.grey, 255), onto, size, flags=cv2.INTER_NEAREST)
        change[cv2.erode(seen, np.ones((7, 7), np.uint8)) == 0] = 0
        return change, image


def _background(before: Mask, now: Mask) -> NDArray[np.float64] | None:
    """(3, 3) homography that moves the background so; None where too little moves as one."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.01, before.shape[1] / 40)
    if corners is None or len(corners) < _FEWEST:
        return None
    start = np.asarray(corners, np.float32)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, now, start, start.copy(), winSize=(15, 15), maxLevel=3)
    kept = np.asarray(found).ravel() == 1
    if kept.sum() < _FEWEST:
        return None
    onto, agree = cv2.findHomography(start[kept], np.asarray(moved)[kept], cv2.RANSAC, 1.0, maxIters=500)
    if onto is None or float(np.mean(agree)) < _BACKGROUND_FRAC:
        return None
    return np.asarray(onto, np.float64)


@dataclass(frozen=True, slots=True)
class _Part:
    """In px of the small copy."""

    x: float
    y: float
    w: float
    h: float
    weight: float

    def moving(self, scale: float) -> Moving:
        """With a pixel around it, in px of the full picture."""
        x, y, w, h = ((v * scale) for v in (self.x - 1, self.y - 1, self.w + 2, self.h + 2))
        return Moving(Box.from_xywh(x, y, w, h), self.weight)

    def is_near(self, other: _Part) -> bool:
        """So near that both are one thing."""
        gap_x = max(self.x, other.x) - min(self.x + self.w, other.x + other.w)
        gap_y = max(self.y, other.y) - min(self.y + self.h, other.y + other.h)
        return gap_x < max(_GAP_PX, _GAP_FRAC * max(self.w, other.w)) and gap_y < max(
            _GAP_PX, _GAP_FRAC * max(self.h, other.h)
        )

    def joined(self, other: _Part) -> _Part:
        """Both as one."""
        x, y = min(self.x, other.x), min(self.y, other.y)
        right, bottom = max(self.x + self.w, other.x + other.w), max(self.y + self.h, other.y + other.h)
        return _Part(x, y, right - x, bottom - y, self.weight + other.weight)


def _parts(change: Mask, now: Image, behind: Image) -> list[_Part]:
    threshold = max(_LEAST_GREY, _MEANS * float(change.mean()))
    moved = cv2.morphologyEx((change > threshold).astype(np.uint8), cv2.MORPH_CLOSE, _CLOSE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(moved)
    found: list[_Part] = []
    for label in range(1, count):
        x, y, w, h, area = (int(value) for value in stats[label])
        if area < _LEAST_PX:
            continue
        here = np.s_[y : y + h, x : x + w]
        own = labels[here] == label
        weight = float(change[here][own].sum())
        solid = _without_shadow(own, now[here], behind[here])
        if solid.sum() < _SOLID_FRAC * area:
            found.append(_Part(x, y, w, h, weight * _SHADOW_WEIGHT))
            continue
        _, _, pieces, _ = cv2.connectedComponentsWithStats(solid)
        for px, py, pw, ph, part_area in pieces[1:].tolist():
            if part_area >= max(_LEAST_PX, _SOLID_FRAC / 2 * area):
                found.append(_Part(x + px, y + py, pw, ph, weight * part_area / area))
    return found


def _without_shadow(own: NDArray[np.bool_], now: Image, behind: Image) -> Mask:
    """1 where the thing is more than a darker copy of what is behind it."""
    ratio = (now.astype(np.float32) + 4) / (behind.astype(np.float32) + 4)
    mean = ratio.mean(2)
    shadow = (mean > _SHADE_LEAST) & (mean < _SHADE_MOST) & (np.ptp(ratio, axis=2) < _SHADE_COLOUR)
    solid = cv2.morphologyEx((own & ~shadow).astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return np.asarray(cv2.morphologyEx(solid, cv2.MORPH_CLOSE, _CLOSE), np.uint8) & own.astype(np.uint8)


def _merged(parts: list[_Part]) -> list[_Part]:
    done: list[_Part] = []
    left = list(parts)
    while left:
        part = left.pop()
        near = next((other for other in done if part.is_near(other)), None)
        if near is None:
            done.append(part)
        else:
            done.remove(near)
            left.append(part.joined(near))
    return done
