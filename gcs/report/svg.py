"""Charts as SVG that stands in a page: coloured by its style sheet, read with the mouse by <title>, no script."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from gcs.report.sampling import Curve
from gcs.report.words import clock

WIDTH_PX, HEIGHT_PX = 540, 210
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 46, 8, 10, 26
_COLUMNS: Final = 60  # of the chart that tell their values
_TIME_STEPS_S: Final = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200)
_FAR: Final = 2.5  # a level further off than so many times the curve's range would flatten it


@dataclass(frozen=True, slots=True)
class Line:
    """A curve with its name; css: its class, a to d."""

    name: str
    curve: Curve
    css: str = "a"


@dataclass(frozen=True, slots=True)
class Level:
    """A limit, or what is wanted, as a dashed line over the whole time."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class Shade:
    """A time in which something was so; css: its class; href: where it is told."""

    start_s: float
    end_s: float
    css: str
    title: str
    href: str


@dataclass(frozen=True, slots=True)
class Scale:
    """From values to px, linear; low and high are different."""

    low: float
    high: float
    start_px: float
    end_px: float

    def px(self, value: float) -> float:
        """Where it is drawn."""
        share = (value - self.low) / (self.high - self.low)
        return self.start_px + share * (self.end_px - self.start_px)


@dataclass(frozen=True, slots=True)
class TimeChart:
    """Curves over the flight's time; span_s: its length. zero: the axis begins at 0."""

    title: str
    unit: str
    lines: Sequence[Line]
    span_s: float
    levels: Sequence[Level] = ()
    shades: Sequence[Shade] = ()
    zero: bool = False

    def svg(self) -> str:
        """Empty where there is nothing to draw."""
        if not any(line.curve for line in self.lines):
            return ""
        x = Scale(0.0, max(self.span_s, 1e-3), LEFT_PX, WIDTH_PX - RIGHT_PX)
        near = self._near()
        y = self._y(near)
        parts = [
            *self._shades(x), *y_axis(y, x), *time_axis(x),
            *(f'<path class="level" d="M{x.start_px} {y.px(level.value):.1f}H{x.end_px}"/>' for level in near),
            *(path for line in self.lines for path in _paths(line, x, y)), *_names(near, x, y), *self._hovers(x),
        ]  # fmt: skip
        return svg(self.title, WIDTH_PX, HEIGHT_PX, parts)

    @property
    def beyond(self) -> tuple[Level, ...]:
        """Levels that are too far off to be drawn."""
        near = self._near()
        return tuple(level for level in self.levels if level not in near)

    def _range(self) -> tuple[float, float]:
        curves = [line.curve for line in self.lines if line.curve]
        low, high = min(c.lowest for c in curves), max(c.highest for c in curves)
        if self.zero:
            return min(low, 0.0), max(high, 0.0) or 1.0
        return low, high

    def _near(self) -> tuple[Level, ...]:
        low, high = self._range()
        reach = max(high - low, abs(high) * 0.2, 1e-9) * _FAR
        return tuple(level for level in self.levels if low - reach <= level.value <= high + reach)

    def _y(self, near: Sequence[Level]) -> Scale:
        low, high = self._range()
        low, high = min([low, *(level.value for level in near)]), max([high, *(level.value for level in near)])
        room = (high - low or max(abs(high), 1.0)) * 0.06
        bottom = low if self.zero and low == 0.0 else low - room
        return Scale(bottom, high + room, HEIGHT_PX - BOTTOM_PX, TOP_PX)

    def _shades(self, x: Scale) -> Iterator[str]:
        for shade in self.shades:
            width_px = max(x.px(shade.end_s) - x.px(shade.start_s), 1.0)
            yield (
                f'<rect class="{shade.css} shade" x="{x.px(shade.start_s):.1f}" y="{TOP_PX}" width="{width_px:.1f}" '
                f'height="{HEIGHT_PX - TOP_PX - BOTTOM_PX}"/>'
            )

    def _hovers(self, x: Scale) -> Iterator[str]:
        """Columns that tell their values, and lead to what happened in them."""
        step_s = self.span_s / _COLUMNS
        values = [_by_column(line.curve, step_s) for line in self.lines]
        for column in range(_COLUMNS):
            start_s, end_s = column * step_s, (column + 1) * step_s
            said = [
                f"{line.name} {_extent(*found[column])} {self.unit}"
                for line, found in zip(self.lines, values, strict=True)
                if column in found
            ]
            shade = next((s for s in self.shades if s.start_s < end_s and s.end_s > start_s), None)
            if not said and shade is None:
                continue
            title = "\n".join([clock(start_s), *said, *([] if shade is None else [shade.title])])
            rect = (
                f'<rect class="hover" x="{x.px(start_s):.1f}" y="{TOP_PX}" width="{x.px(end_s) - x.px(start_s):.1f}" '
                f'height="{HEIGHT_PX - TOP_PX - BOTTOM_PX}"><title>{escape(title)}</title></rect>'
            )
            yield rect if shade is None else f'<a href="{escape(shade.href)}">{rect}</a>'


def svg(title: str, width_px: int, height_px: int, parts: Sequence[str]) -> str:
    """The element, as wide as its place in the page."""
    return (
        f'<svg viewBox="0 0 {width_px} {height_px}" role="img" aria-label="{escape(title)}">'
        + "".join(parts)
        + "</svg>"
    )


def time_axis(x: Scale) -> Iterator[str]:
    """Ticks and their times below the chart."""
    step_s = next((s for s in _TIME_STEPS_S if s * 7 >= x.high), x.high / 6)
    base_px = HEIGHT_PX - BOTTOM_PX
    yield f'<path class="axis" d="M{LEFT_PX} {base_px}H{WIDTH_PX - RIGHT_PX}"/>'
    for index in range(int(x.high / step_s) + 1):
        at_px = x.px(index * step_s)
        anchor = "end" if at_px > WIDTH_PX - RIGHT_PX - 14 else "middle"
        yield f'<path class="axis" d="M{at_px:.1f} {base_px}v4"/>'
        yield f'<text x="{at_px:.1f}" y="{base_px + 17}" text-anchor="{anchor}">{clock(index * step_s)[:-2]}</text>'


def y_axis(y: Scale, x: Scale) -> Iterator[str]:
    """Lines across the chart with their values at the left."""
    for value in ticks(y.low, y.high):
        at_px = y.px(value)
        yield f'<path class="grid" d="M{x.start_px} {at_px:.1f}H{x.end_px}"/>'
        yield f'<text x="{LEFT_PX - 5}" y="{at_px + 4:.1f}" text-anchor="end">{number(value)}</text>'


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round values within, at most so many and one."""
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 2.5, 5, 10) if power * factor >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [index * step for index in range(first, math.floor(high / step + 1e-9) + 1)]


def number(value: float) -> str:
    """For an axis."""
    text = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return text.replace("-", "−")


def _names(levels: Sequence[Level], x: Scale, y: Scale) -> Iterator[str]:
    """At the right end of each, above it where there is room."""
    for level in levels:
        at_px = y.px(level.value)
        name_px = at_px - 3 if at_px > TOP_PX + 14 else at_px + 12
        place = f'x="{x.end_px - 3}" y="{name_px:.1f}" text-anchor="end"'
        yield f'<text class="level" {place}>{escape(_said(level))}</text>'


def _paths(line: Line, x: Scale, y: Scale) -> Iterator[str]:
    for piece in line.curve.pieces:
        points = [f"{x.px(t_s):.1f} {y.px(value):.1f}" for t_s, value in piece]
        more = "h.1" if len(points) == 1 else "L" + "L".join(points[1:])
        yield f'<path class="line {line.css}" d="M{points[0]}{more}"/>'


def _said(level: Level) -> str:
    return f"{level.name} {number(level.value)}" if level.value else level.name


def _by_column(curve: Curve, step_s: float) -> dict[int, tuple[float, float]]:
    """The lowest and the highest value in each column of time."""
    found: dict[int, tuple[float, float]] = {}
    for piece in curve.pieces:
        for t_s, value in piece:
            column = min(max(int(t_s / step_s), 0), _COLUMNS - 1) if step_s > 0 else 0
            low, high = found.get(column, (value, value))
            found[column] = (min(low, value), max(high, value))
    return found


def _extent(low: float, high: float) -> str:
    one, other = f"{low:.3g}", f"{high:.3g}"
    return one if one == other else f"{one} to {other}"
