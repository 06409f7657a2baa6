"""The pictures of the moments that matter: what was confirmed, and each loss as last seen, hidden, and found again."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from gcs.hud import Overlay, Tone, draw_boxes
from gcs.replay.film import Film
from gcs.replay.log import FrameRow
from gcs.report.tally_follow import Episode, FollowTally, Missing
from gcs.video.frame import Image
from tracker.box import Box

WIDTH_PX: Final = 320
_MOST_LOSSES, _MOST_CONFIRMED = 12, 4
_JPEG: Final = (cv2.IMWRITE_JPEG_QUALITY, 80)
_AROUND: Final = 8.0  # what is shown is so many times as wide as the box,
_LEAST_FRAC: Final = 0.5  # and at least so much of the picture


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture, or the part of it round the target. uri: the JPEG as a data URI."""

    name: str
    t_s: float
    uri: str
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class _Wanted:
    key: str
    name: str
    row: FrameRow
    like: Box | None  # where to look where nothing is seen
    tone: Tone


def pictures_of(tally: FollowTally, film: Film) -> dict[str, list[Shot]]:
    """By `key_of`; the film is asked in order of time. What was not filmed is left out."""
    wanted = [*_confirmed(tally.episodes), *_lost(tally.missing)]
    found: dict[str, list[Shot]] = {}
    for one in sorted(wanted, key=lambda w: (w.row.t_arrival_s, w.key)):
        image_bgr = film.picture(one.row)
        if image_bgr is not None:
            shot = _shot(one, image_bgr, film.is_annotated, tally.start_s)
            found.setdefault(one.key, []).append(shot)
    return found


def key_of(kind: str, number: int) -> str:
    """Of a follow or a loss, counted from 0."""
    return f"{kind}-{number + 1}"


def _confirmed(episodes: Sequence[Episode]) -> list[_Wanted]:
    rows = [(number, one.frame) for number, one in enumerate(episodes[:_MOST_CONFIRMED])]
    return [
        _Wanted(key_of("follow", number), "as confirmed", row, None, Tone.GOOD)
        for number, row in rows
        if row is not None
    ]


def _lost(missing: Sequence[Missing]) -> list[_Wanted]:
    """Of those that ended a follow, and the longest."""
    losses = [one.loss for one in missing]
    worst = sorted(range(len(losses)), key=lambda n: (losses[n].found, losses[n].start_s - losses[n].end_s))
    wanted = []
    for number in worst[:_MOST_LOSSES]:
        one, key = missing[number], key_of("loss", number)
        like = None if one.seen is None else _box(one.seen)
        for name, row, tone in (
            ("last seen", one.seen, Tone.GOOD), ("lost", one.hidden, Tone.ALARM), ("found again", one.again, Tone.GOOD),
        ):  # fmt: skip
            if row is not None:
                wanted.append(_Wanted(key, name, row, like, tone))
    return wanted


def _box(row: FrameRow) -> Box | None:
    result = row.tracked
    return result.box if result is not None and result.visible and result.box.is_valid else None


def _shot(wanted: _Wanted, image_bgr: Image, is_annotated: bool, start_s: float) -> Shot:
    row, box = wanted.row, _box(wanted.row)
    centre = box or row.predicted or wanted.like
    left, top, width, height = window(image_bgr.shape[1], image_bgr.shape[0], centre)
    part = image_bgr[top : top + height, left : left + width]
    scale = WIDTH_PX / width
    shrink = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    part = cv2.resize(part, (WIDTH_PX, max(round(height * scale), 1)), interpolation=shrink).astype(np.uint8)
    if not is_annotated:

        def placed(found: Box | None) -> Box | None:
            if found is None:
                return None
            cx_px, cy_px = (found.cx_px - left) * scale, (found.cy_px - top) * scale
            return Box(cx_px, cy_px, found.w_px * scale, found.h_px * scale)

        part = draw_boxes(part, Overlay("", wanted.tone, placed(box), placed(row.predicted)))
    jpeg = cv2.imencode(".jpg", part, _JPEG)[1].tobytes()
    uri = f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"
    return Shot(wanted.name, row.t_capture_s - start_s, uri, part.shape[1], part.shape[0])


def window(image_w_px: int, image_h_px: int, box: Box | None) -> tuple[int, int, int, int]:
    """Left, top, width and height of what is shown: the picture's own shape, round the box, within the picture."""
    if box is None or not box.is_valid:
        return 0, 0, image_w_px, image_h_px
    frac = max(_AROUND * box.w_px / image_w_px, _AROUND * box.h_px / image_h_px, _LEAST_FRAC, WIDTH_PX / image_w_px)
    frac = min(frac, 1.0)
    width_px, height_px = round(image_w_px * frac), max(round(image_h_px * frac), 1)
    left_px = min(max(round(box.cx_px - width_px / 2), 0), image_w_px - width_px)
    top_px = min(max(round(box.cy_px - height_px / 2), 0), image_h_px - height_px)
    return left_px, top_px, width_px, height_px
