"""What a target looks like, as far as it can be compared, and whether something found is it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.crop import Image, context_side_px, mean_colour
from tracker.engines.engine import Engine

Array = NDArray[np.float32]

COLOUR_SIDE_PX = 24  # colours are counted in a box scaled to this, so that all boxes count alike
COLOUR_FILL = 0.7  # part of the box's sides that is counted: its corners are background
LAB_BINS = (8, 12, 12)
LAB_LOW, LAB_HIGH = (0, 88, 88), (256, 168, 168)  # colours outdoors are dull: beyond goes into the outer bins
MAX_DISTRACTORS = 12
MAX_RELATIVE_SCORE = 1.5
SAME_DISTRACTOR = 0.95  # similarity from which two are one and the same


@dataclass(frozen=True, slots=True)
class Appearance:
    """One box in one frame: unit feature vectors per cell, layers 4 (c4, 8, 8) and 5 (c5, 6, 6); Lab histogram."""

    layer4: Array
    layer5: Array
    colours: Array


@dataclass(frozen=True, slots=True)
class Likeness:
    """How alike two appearances are: mean cosine of cells (-1..1) in each layer, overlap of colours (0..1)."""

    layer4: float
    layer5: float
    colour: float

    @property
    def mean(self) -> float:
        """All three in one."""
        return (self.layer4 + self.layer5 + self.colour) / 3


@dataclass(frozen=True, slots=True)
class CueWeights:
    """Weights of the cues in the log-odds that a candidate is the target (logistic regression).

    Fitted on candidates in held-out and training clips, none of the development sequences among them.
    score is relative to the network's score of the target in its first frame.
    """

    score: float = 2.4
    layer4: float = 3.2
    layer5: float = 1.25
    colour: float = 2.5
    bias: float = -4.2

    def log_odds(self, relative_score: float, likeness: Likeness) -> float:
        """Above 0: more likely the target than not."""
        return (
            self.score * min(relative_score, MAX_RELATIVE_SCORE)
            + self.layer4 * likeness.layer4
            + self.layer5 * likeness.layer5
            + self.colour * likeness.colour
            + self.bias
        )


class Describer:
    """Makes appearances with the tracker's own backbone; one pass over a template patch each.

    Features are taken less their mean over the surroundings in the first frame, as all of them share
    much that tells nothing apart.
    """

    def __init__(self, engine: Engine, config: TrackerConfig, frame_bgr: Image, box: Box) -> None:
        self._engine, self._config = engine, config
        self._fill = mean_colour(frame_bgr)
        side_px = context_side_px(box.w_px, box.h_px, config.context_frac) * config.search_px / config.exemplar_px
        layers = self._features(frame_bgr, box, round(side_px), config.search_px)
        self._means = tuple(layer.mean((1, 2), keepdims=True) for layer in layers)

    def describe(self, frame_bgr: Image, box: Box) -> Appearance:
        """Appearance of what is in this box of this frame."""
        side_px = round(context_side_px(box.w_px, box.h_px, self._config.context_frac))
        layers = self._features(frame_bgr, box, side_px, self._config.exemplar_px)
        layer4, layer5 = (_unit(layer - mean) for layer, mean in zip(layers, self._means, strict=True))
        return Appearance(layer4, layer5, colours(frame_bgr, box))

    def _features(self, frame_bgr: Image, box: Box, side_px: int, out_px: int) -> tuple[Array, ...]:
        layers = self._engine.embed(
            self._engine.cut(frame_bgr, box.cx_px, box.cy_px, max(1, side_px), out_px, self._fill)
        )
        return tuple(layer[0].float().cpu().numpy() for layer in layers[-2:])  # HiFT's begin with layer 3


def colours(frame_bgr: Image, box: Box) -> Array:
    """Joint histogram (1152,) of the Lab colours in the middle of the box; sums to 1."""
    size = (max(2, round(box.w_px * COLOUR_FILL)), max(2, round(box.h_px * COLOUR_FILL)))
    patch = cv2.getRectSubPix(frame_bgr, size, (box.cx_px, box.cy_px))
    patch = cv2.resize(patch, (COLOUR_SIDE_PX, COLOUR_SIDE_PX), interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(patch, cv2.COLOR_BGR2LAB).reshape(-1, 3).astype(np.float32)
    bins = np.array(LAB_BINS)
    cells = (lab - LAB_LOW) * bins / np.subtract(LAB_HIGH, LAB_LOW)
    cells = np.clip(cells.astype(int), 0, bins - 1)
    counts = np.bincount(np.ravel_multi_index(tuple(cells.T), LAB_BINS), minlength=math.prod(LAB_BINS))
    return np.asarray(counts / len(lab), np.float32)


def likeness(a: Appearance, b: Appearance) -> Likeness:
    """Cell by cell, the middle counting most; colours by Bhattacharyya's coefficient."""
    return Likeness(
        _cosine(a.layer4, b.layer4), _cosine(a.layer5, b.layer5), float(np.sqrt(a.colours * b.colours).sum())
    )


class Distractors:
    """Appearances of other things seen while it was known where the target is."""

    def __init__(self) -> None:
        self._seen: deque[Appearance] = deque(maxlen=MAX_DISTRACTORS)

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, appearance: Appearance) -> None:
        """Keep this one; it takes the place of one that looks the same, or else of the oldest."""
        for i, old in enumerate(self._seen):
            if likeness(old, appearance).mean > SAME_DISTRACTOR:
                self._seen[i] = appearance
                return
        self._seen.append(appearance)

    def likeness(self, appearance: Appearance) -> float:
        """Mean likeness to the one most alike; -1 if none is known."""
        return max((likeness(old, appearance).mean for old in self._seen), default=-1.0)


def _unit(layer: Array) -> Array:
    return np.asarray(layer / (np.linalg.norm(layer, axis=0, keepdims=True) + 1e-9), np.float32)


def _cosine(a: Array, b: Array) -> float:
    cells = a.shape[-1]
    along = np.exp(-0.5 * ((np.arange(cells) - (cells - 1) / 2) / (0.2 * cells)) ** 2)
    weights = np.outer(along, along)
    return float((np.einsum("chw,chw->hw", a, b) * weights).sum() / weights.sum())
