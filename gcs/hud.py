"""What the operator sees on the picture: boxes, state, figures. Drawn to be read outdoors.

Bright lines over dark outlines stand out on any background; text stands on dark bands.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box

Image = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

WHITE: Colour = (255, 255, 255)
BLACK: Colour = (0, 0, 0)
GREEN: Colour = (80, 255, 80)
AMBER: Colour = (0, 190, 255)
RED: Colour = (60, 60, 255)
CYAN: Colour = (255, 230, 60)
FONT = cv2.FONT_HERSHEY_SIMPLEX


class Tone(Enum):
    """How urgent the state banner is."""

    CALM = "calm"
    GOOD = "good"
    CAUTION = "caution"
    ALARM = "alarm"


TONE_COLOURS: dict[Tone, Colour] = {Tone.CALM: WHITE, Tone.GOOD: GREEN, Tone.CAUTION: AMBER, Tone.ALARM: RED}


@dataclass(frozen=True, slots=True)
class Overlay:
    """What to draw; None leaves a part out.

    box: the tracker's; predicted: the filter's, projected back. confidence 0..1. standoff_error_m: measured minus
    wanted distance. watermark: what this picture is not, e.g. DRY RUN or SIM. lines: figures at the lower left.
    """

    state: str
    tone: Tone = Tone.CALM
    box: Box | None = None
    predicted: Box | None = None
    confidence: float | None = None
    distance_m: float | None = None
    standoff_error_m: float | None = None
    latency_s: float | None = None
    watermark: str | None = None
    lines: tuple[str, ...] = ()


def draw(image_bgr: Image, overlay: Overlay) -> Image:
    """Draw onto a copy of the (H, W, 3) uint8 picture and return it."""
    image = image_bgr.copy()
    scale = _scale(image)
    colour = TONE_COLOURS[overlay.tone]
    _banner(image, overlay, colour, scale)
    _figures(image, overlay.lines, scale)
    # Above the bands: a target at the picture's edge is about to be lost, and must show most of all.
    image = draw_boxes(image, overlay)
    if overlay.watermark:
        _watermark(image, overlay.watermark, scale)
    return image


def draw_boxes(image_bgr: Image, overlay: Overlay) -> Image:
    """The two boxes alone, drawn into the picture itself; returns it."""
    scale = _scale(image_bgr)
    if overlay.predicted is not None and overlay.predicted.is_valid:
        _brackets(image_bgr, overlay.predicted, CYAN, scale)
    if overlay.box is not None and overlay.box.is_valid:
        _box(image_bgr, overlay.box, TONE_COLOURS[overlay.tone], scale)
    return image_bgr


def _scale(image: Image) -> float:
    """1 at 720 lines; text must stay readable on small pictures."""
    return max(0.45, float(image.shape[0]) / 720)


def _px(length: float, scale: float) -> int:
    return max(1, round(length * scale))


def _corners(image: Image, box: Box) -> tuple[tuple[int, int], tuple[int, int]]:
    """Top-left and bottom-right in px, kept near the picture: OpenCV's coordinates are 16 bit in places."""
    h_px, w_px = image.shape[:2]
    x, y, w, h = box.xywh
    left, right = (round(min(max(v, -w_px), 2 * w_px)) for v in (x, x + w))
    top, bottom = (round(min(max(v, -h_px), 2 * h_px)) for v in (y, y + h))
    return (left, top), (right, bottom)


def _box(image: Image, box: Box, colour: Colour, scale: float) -> None:
    start, end = _corners(image, box)
    cv2.rectangle(image, start, end, BLACK, _px(5, scale))
    cv2.rectangle(image, start, end, colour, _px(2, scale))


def _brackets(image: Image, box: Box, colour: Colour, scale: float) -> None:
    """Four corners only, so that it can never be taken for the tracker's own box."""
    (left, top), (right, bottom) = _corners(image, box)
    arm_x, arm_y = max(4, (right - left) // 4), max(4, (bottom - top) // 4)
    arms = [
        np.array([[x, y + dy], [x, y], [x + dx, y]], dtype=np.int32)
        for x, dx in ((left, arm_x), (right, -arm_x))
        for y, dy in ((top, arm_y), (bottom, -arm_y))
    ]
    cv2.polylines(image, arms, False, BLACK, _px(5, scale))
    cv2.polylines(image, arms, False, colour, _px(2, scale))


def _banner(image: Image, overlay: Overlay, colour: Colour, scale: float) -> None:
    """The state in large letters at the top left, the figures that matter beside it."""
    height = _px(44, scale)
    _darken(image, 0, height)
    size, thickness = 0.95 * scale, _px(2, scale)
    baseline = round(height * 0.72)
    x = _px(14, scale)
    cv2.putText(image, overlay.state, (x, baseline), FONT, size, colour, thickness, cv2.LINE_AA)
    right = image.shape[1] - _px(14, scale)
    room = right - x - cv2.getTextSize(overlay.state, FONT, size, thickness)[0][0] - _px(20, scale)
    text = _fitting(_banner_parts(overlay), 0.75 * scale, room)
    width = cv2.getTextSize(text, FONT, 0.75 * scale, _px(1.6, scale))[0][0]
    cv2.putText(image, text, (right - width, baseline), FONT, 0.75 * scale, WHITE, _px(1.6, scale), cv2.LINE_AA)


def _banner_parts(overlay: Overlay) -> list[str]:
    """In the order of their importance: a narrow picture drops the last ones."""
    parts = []
    if overlay.confidence is not None:
        parts.append(f"conf {overlay.confidence:.0%}")
    if overlay.distance_m is not None:
        parts.append(f"dist {overlay.distance_m:.0f} m")
    if overlay.standoff_error_m is not None:
        parts.append(f"err {overlay.standoff_error_m:+.1f} m")
    if overlay.latency_s is not None:
        parts.append(f"lat {overlay.latency_s * 1000:.0f} ms")
    return parts


def _fitting(parts: list[str], size: float, room_px: int) -> str:
    while parts and cv2.getTextSize("   ".join(parts), FONT, size, 1)[0][0] > room_px:
        parts = parts[:-1]
    return "   ".join(parts)


def _figures(image: Image, lines: tuple[str, ...], scale: float) -> None:
    if not lines:
        return
    step = _px(28, scale)
    top = max(0, image.shape[0] - step * len(lines) - _px(10, scale))
    _darken(image, top, image.shape[0])
    for index, line in enumerate(lines):
        at = (_px(14, scale), top + step * (index + 1) - _px(4, scale))
        cv2.putText(image, line, at, FONT, 0.65 * scale, WHITE, _px(1.4, scale), cv2.LINE_AA)


def _darken(image: Image, top: int, bottom: int) -> None:
    """Half-dark band over the whole width, so that text is readable over snow as over forest."""
    band = image[top:bottom]
    cv2.convertScaleAbs(band, dst=band, alpha=0.35)


def _watermark(image: Image, text: str, scale: float) -> None:
    """At the right, under the banner, framed: nobody may take this picture for a flight."""
    size, thickness = 0.9 * scale, _px(2, scale)
    (width, height), _ = cv2.getTextSize(text, FONT, size, thickness)
    margin = _px(12, scale)
    right, top = image.shape[1] - margin, _px(44, scale) + margin
    start = (right - width - 2 * margin, top)
    end = (right, top + height + 2 * margin)
    cv2.rectangle(image, start, end, BLACK, -1)
    cv2.rectangle(image, start, end, AMBER, _px(2, scale))
    cv2.putText(image, text, (start[0] + margin, end[1] - margin), FONT, size, AMBER, thickness, cv2.LINE_AA)
