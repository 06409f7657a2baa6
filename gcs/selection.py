"""Choosing what to track: a typed box, or one drawn on the first frame."""

from __future__ import annotations

import math
import os
import sys
from typing import Any

from gcs.errors import SelectionError
from gcs.video.frame import Image
from tracker.box import Box

MIN_SIDE_PX = 10.0
EDGE_SLACK_PX = 2.0


def parse_box(text: str) -> Box:
    """`x,y,w,h` in px, x and y of the top-left corner. Raises SelectionError."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        raise SelectionError(f"--box {text!r}: must be x,y,w,h in pixels, e.g. 100,80,60,40") from None
    if not all(map(math.isfinite, (x, y, w, h))):
        raise SelectionError(f"--box {text!r}: must be finite numbers")
    return Box.from_xywh(x, y, w, h)


def check_box(box: Box, width_px: int, height_px: int, min_side_px: float = MIN_SIDE_PX) -> Box:
    """The box, its edges clipped to the frame. Raises SelectionError when it is too small or reaches outside."""
    x, y, w, h = box.xywh
    shown = f"box {x:g},{y:g},{w:g},{h:g}"
    if min(w, h) < min_side_px:
        raise SelectionError(f"{shown}: under {min_side_px:g} px; a target that small cannot be tracked")
    slack = EDGE_SLACK_PX
    if x < -slack or y < -slack or x + w > width_px + slack or y + h > height_px + slack:
        raise SelectionError(f"{shown}: outside the frame of {width_px}x{height_px} px")
    left, top = max(x, 0.0), max(y, 0.0)
    return Box.from_xywh(left, top, min(x + w, width_px) - left, min(y + h, height_px) - top)


def draw_box(image_bgr: Image) -> Box:
    """Let the operator draw a box in a window. Raises SelectionError without a display or without a box."""
    plt = _pyplot()
    figure = plt.figure("Draw a box round the target, then close the window", figsize=(12, 7))
    drawing = BoxDrawing(figure, image_bgr)
    plt.show()
    if drawing.box is None:
        raise SelectionError("no box was drawn")
    return drawing.box


class BoxDrawing:
    """One picture in a matplotlib figure with a rectangle to draw on it; `box` is the newest one."""

    def __init__(self, figure: Any, image_bgr: Image) -> None:
        from matplotlib.widgets import RectangleSelector

        self.box: Box | None = None
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.imshow(image_bgr[:, :, ::-1])
        self._selector = RectangleSelector(axes, self._drawn, useblit=False, interactive=True)

    def _drawn(self, _press: Any, _release: Any) -> None:
        left, right, top, bottom = (float(edge) for edge in self._selector.extents)
        self.box = Box.from_xywh(left, top, right - left, bottom - top)


def _pyplot() -> Any:
    hint = "--select needs a display; without one give --box x,y,w,h"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SelectionError(hint)
    import matplotlib
    from matplotlib import pyplot as plt
    from matplotlib.backends import backend_registry
    from matplotlib.backends.registry import BackendFilter

    try:
        plt.switch_backend(matplotlib.rcParams["backend"])
    except ImportError as error:
        raise SelectionError(f"--select: no window toolkit ({error}); give --box x,y,w,h") from error
    interactive = backend_registry.list_builtin(BackendFilter.INTERACTIVE)
    if matplotlib.get_backend().lower() not in [name.lower() for name in interactive]:
        raise SelectionError("--select: Python has no window toolkit (e.g. tkinter); give --box x,y,w,h")
    return plt
