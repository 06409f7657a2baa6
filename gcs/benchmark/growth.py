"""How the cost of a tracked, shown picture grows with its size."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.benchmark.coded import h264_cases, jpeg_case
from gcs.benchmark.films import Film, resized
from gcs.benchmark.stages_station import of_picture
from gcs.benchmark.timing import Case, Figure
from gcs.benchmark.trackers import OnFilm, shipped
from tracker.engines.catalogue import TORCH

SIZES: Final = {"480p": (854, 480), "720p": (1280, 720), "1080p": (1920, 1080), "4K": (3840, 2160)}
_FRAMES: Final = 8
_TRACK: Final = f"track, compact, {TORCH}"
# What each picture costs that is tracked and shown on the page; H.264 where it can be decoded, else JPEG.
_PARTS: Final = ("fingerprint", "background flow", _TRACK, "JPEG for the page")


@dataclass(frozen=True, slots=True)
class Size:
    """CPU ms of one picture; parts by their names, the decoder's first."""

    name: str
    size: tuple[int, int]
    parts: Mapping[str, float]

    @property
    def total_ms(self) -> float:
        """Of all parts."""
        return sum(self.parts.values())


def cases(film: Film, note: Callable[[str], None], *, quick: bool) -> Iterator[Case]:
    """film: the first pictures are enough."""
    weights = next(weights for weights in shipped() if weights.name == "compact")
    for name in ("480p", "720p") if quick else SIZES:
        large = resized(Film(film.name, film.frames[:_FRAMES], film.box), *SIZES[name])
        label = f", {name}"
        yield from h264_cases(large.frames, note, label)
        yield jpeg_case(large.frames[0], label)
        yield from of_picture(list(large.frames), large.box, label)
        yield OnFilm(f"{_TRACK}{label}", large, lambda: weights.tracker(TORCH, 1))


def sizes(figures: Sequence[Figure]) -> list[Size]:
    """What the cases came to."""
    found = {figure.name: figure.cost_ms for figure in figures}
    return [_size(name, found) for name in SIZES if f"{_TRACK}, {name}" in found]


def _size(name: str, found: Mapping[str, float]) -> Size:
    decode = next(part for part in ("H.264 decode", "JPEG decode") if f"{part}, {name}" in found)
    return Size(name, SIZES[name], {part: found[f"{part}, {name}"] for part in (decode, *_PARTS)})
