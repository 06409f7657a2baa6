"""Patches to calibrate on, cut from videos with boxes as the tracker would cut them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.crop import Image, context_side_px, crop, mean_colour
from tracker.engines.engine import EngineError
from tracker.eval.sequences import Sequence as Footage
from tracker.eval.sequences import read_boxes


def footage(videos: Sequence[Path]) -> list[Footage]:
    """Each video with its boxes, x,y,w,h a line, in the .txt beside it. Raises SequenceError."""
    return [Footage(video.stem, video, read_boxes(video.with_suffix(".txt"))) for video in videos]


def search_patches(
    sequences: Sequence[Footage],
    count: int,
    config: TrackerConfig,
    on_frame: Callable[[], object] = lambda: None,
) -> list[Image]:
    """About `count` search patches (S, S, 3) uint8 of objects in their middle, evenly spread over the frames.

    on_frame is called for each frame read. Raises SequenceError for a video that cannot be read, EngineError where
    no frame has a box.
    """
    step = max(1, sum(map(len, sequences)) // count)
    patches = []
    for sequence in sequences:
        fill = None
        for i, (image, xywh) in enumerate(zip(sequence.images(), sequence.truth_xywh, strict=True)):
            fill = fill or mean_colour(image)
            on_frame()
            if i % step == 0 and np.isfinite(xywh).all() and min(xywh[2:]) > 0:
                box = Box.from_xywh(*(float(v) for v in xywh))
                template_px = context_side_px(box.w_px, box.h_px, config.context_frac)
                side_px = max(1, round(template_px * config.search_px / config.exemplar_px))
                patches.append(crop(image, box.cx_px, box.cy_px, side_px, config.search_px, fill))
    if not patches:
        raise EngineError("int8: the videos' boxes hold no object to calibrate on")
    return patches
