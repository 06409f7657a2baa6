"""The tracker's box and the filter's, as Foxglove draws them on a picture."""

from __future__ import annotations

from typing import Any, Final

from gcs.replay.log import FrameRow
from tracker.box import Box

_LINE_LOOP: Final = 2
_CLEAR: Final = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0}
_FOUND: Final = {"r": 0.2, "g": 0.9, "b": 0.3, "a": 1.0}
_HIDDEN: Final = {"r": 1.0, "g": 0.7, "b": 0.1, "a": 1.0}
_PREDICTED: Final = {"r": 0.4, "g": 0.7, "b": 1.0, "a": 0.8}
_DARK: Final = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.6}
_FONT_PX: Final = 14.0


def drawn_boxes(row: FrameRow, stamp: dict[str, int]) -> dict[str, Any]:
    """A `foxglove.ImageAnnotations`, empty where there is no box. stamp: of the picture it is drawn on."""
    points, texts = [], []
    if row.predicted is not None:
        points.append(_loop(row.predicted, _PREDICTED, 1.0, stamp))
    tracked = row.tracked
    if tracked is not None:
        colour = _FOUND if tracked.visible else _HIDDEN
        points.append(_loop(tracked.box, colour, 2.0, stamp))
        texts.append(_text(tracked.box, f"{tracked.confidence:.2f}", colour, stamp))
    return {"timestamp": stamp, "circles": [], "points": points, "texts": texts}


def _loop(box: Box, colour: dict[str, float], thickness: float, stamp: dict[str, int]) -> dict[str, Any]:
    left, top, width, height = box.xywh
    corners = ((left, top), (left + width, top), (left + width, top + height), (left, top + height))
    return {
        "timestamp": stamp, "type": _LINE_LOOP, "points": [{"x": x, "y": y} for x, y in corners],
        "outline_color": colour, "outline_colors": [], "fill_color": _CLEAR, "thickness": thickness,
    }  # fmt: skip


def _text(box: Box, text: str, colour: dict[str, float], stamp: dict[str, int]) -> dict[str, Any]:
    left, top, _, _ = box.xywh
    return {
        "timestamp": stamp, "position": {"x": left, "y": top - 4.0}, "text": text, "font_size": _FONT_PX,
        "text_color": colour, "background_color": _DARK,
    }  # fmt: skip
