"""The latency of all pictures as a histogram, each bar parted by where the time went."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Final

from gcs.report.figures import Percentiles
from gcs.report.svg import HEIGHT_PX, LEFT_PX, RIGHT_PX, TOP_PX, Scale, number, svg, ticks, y_axis
from gcs.report.tally_time import BIN_MS, PARTS, TOTAL, Bin

_WIDTH_PX: Final = 720
_BOTTOM_PX: Final = 40
_BARS: Final = 60
_STEPS_MS: Final = (2, 4, 10, 20, 50, 100, 200, 500, 1000)


def histogram(bins: Mapping[int, Bin], percentiles: Mapping[str, Percentiles]) -> str:
    """Empty where nothing was measured. What is above the 99.9th of a hundred goes into the last bar."""
    if not bins:
        return ""
    low, high = min(bins), _high(bins)
    step_ms = next((s for s in _STEPS_MS if (high - low + 1) * BIN_MS <= s * _BARS), _STEPS_MS[-1])
    bars = _bars(bins, step_ms, high)
    first, last = min(bars), max(bars)
    x = Scale(first * step_ms, (last + 1) * step_ms, LEFT_PX, _WIDTH_PX - RIGHT_PX)
    most = max(bar.count for bar in bars.values())
    y = Scale(0.0, most * 1.12, HEIGHT_PX - _BOTTOM_PX, TOP_PX)
    parts = [*y_axis(y, x), *_axis(x)]
    for index, bar in sorted(bars.items()):
        parts += _bar(bar, index * step_ms, step_ms, x, y, is_last=index == last and max(bins) > high)
    parts += _lines(percentiles[TOTAL], x)
    return svg("histogram of the latency from light to command", _WIDTH_PX, HEIGHT_PX, parts)


def _high(bins: Mapping[int, Bin]) -> int:
    left = 0.999 * sum(found.count for found in bins.values())
    for index in sorted(bins):
        left -= bins[index].count
        if left <= 0:
            return index
    return max(bins)


def _bars(bins: Mapping[int, Bin], step_ms: int, high: int) -> dict[int, Bin]:
    bars: dict[int, Bin] = {}
    for index, found in bins.items():
        bar = bars.setdefault(min(index, high) * BIN_MS // step_ms, Bin())
        bar.count += found.count
        bar.sums_s = [total + part for total, part in zip(bar.sums_s, found.sums_s, strict=True)]
    return bars


def _bar(bar: Bin, start_ms: float, step_ms: float, x: Scale, y: Scale, *, is_last: bool) -> Iterator[str]:
    """Stacked as the time passes, glass at the bottom."""
    means_ms = [total_s / bar.count * 1000 for total_s in bar.sums_s]
    whole_ms = sum(max(mean, 0.0) for mean in means_ms) or 1.0
    left_px, width_px = x.px(start_ms) + 0.5, x.px(start_ms + step_ms) - x.px(start_ms) - 1
    upto = f"{start_ms:g} ms and more" if is_last else f"{start_ms:g} to {start_ms + step_ms:g} ms"
    pictures = f"{bar.count} picture{'s' if bar.count != 1 else ''}"
    said = "\n".join(f"{name} {mean:.1f} ms" for name, mean in zip(PARTS, means_ms, strict=True))
    yield f"<g><title>{escape(f'{upto}: {pictures}, on average')}\n{said}</title>"
    below = 0.0
    for name, mean_ms in zip(PARTS, means_ms, strict=True):
        count = bar.count * max(mean_ms, 0.0) / whole_ms
        top_px, height_px = y.px(below + count), y.px(below) - y.px(below + count)
        below += count
        if height_px > 0.02:
            yield (
                f'<rect class="part-{name}" x="{left_px:.1f}" y="{top_px:.2f}" width="{max(width_px, 0.6):.1f}" '
                f'height="{height_px:.2f}"/>'
            )
    yield "</g>"


def _axis(x: Scale) -> Iterator[str]:
    base_px = HEIGHT_PX - _BOTTOM_PX
    yield f'<path class="axis" d="M{LEFT_PX} {base_px}H{_WIDTH_PX - RIGHT_PX}"/>'
    for value in ticks(x.low, x.high, 8):
        yield f'<path class="axis" d="M{x.px(value):.1f} {base_px}v4"/>'
        yield f'<text x="{x.px(value):.1f}" y="{base_px + 17}" text-anchor="middle">{number(value)}</text>'
    middle_px = (LEFT_PX + _WIDTH_PX - RIGHT_PX) / 2
    yield f'<text x="{middle_px:.0f}" y="{HEIGHT_PX - 6}" text-anchor="middle">ms from light to command</text>'


def _lines(total: Percentiles, x: Scale) -> Iterator[str]:
    """Where half, 95 and 99 of a hundred pictures lie below; the names one below the other, so that none is covered."""
    named = (("p50", total.median_ms), ("p95", total.p95_ms), ("p99", total.p99_ms))
    for row, (name, value_ms) in enumerate(named):
        at_px = x.px(min(max(value_ms, x.low), x.high))
        is_right = at_px > _WIDTH_PX - 90
        yield f'<path class="level" d="M{at_px:.1f} {TOP_PX}V{HEIGHT_PX - _BOTTOM_PX}"/>'
        yield (
            f'<text class="level" x="{at_px + (-4 if is_right else 4):.1f}" y="{TOP_PX + 10 + 17 * row}" '
            f'text-anchor="{"end" if is_right else "start"}">{name} {value_ms:.0f} ms</text>'
        )
