"""The flight from above: paths of vehicle and target, home, fence and standoff, on equal axes in metres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Final

from control.fence import Fence
from gcs.report.figures import Follow
from gcs.report.sampling import Place, Trail
from gcs.report.svg import number, svg, ticks
from gcs.report.words import clock

_WIDTH_PX: Final = 720
_MOST_HEIGHT_PX, _LEAST_HEIGHT_PX = 560, 300
_EDGE_PX: Final = 34
_LEAST_SPAN_M: Final = 10.0
_SIGHTS: Final = 24  # lines of sight that are drawn
_HOVERS: Final = 80


@dataclass(frozen=True, slots=True)
class _Field:
    """From metres north and east to px, the same scale both ways."""

    west_m: float
    north_m: float
    px_per_m: float
    height_px: int

    def px(self, north_m: float, east_m: float) -> tuple[float, float]:
        return _EDGE_PX + (east_m - self.west_m) * self.px_per_m, _EDGE_PX + (self.north_m - north_m) * self.px_per_m


def from_above(vehicle: Trail, target: Trail, follows: Sequence[Follow], fence: Fence | None, home: bool) -> str:
    """Empty where the vehicle never told its place. home: whether the paths' origin is it."""
    if not vehicle.places:
        return ""
    places = [*vehicle.places, *target.places]
    field = _field(places)
    parts = [
        *_grid(field),
        _clip(field),
        *(_fence(field, fence) if fence is not None else ()),
        *_sights(field, vehicle.places, target.places),
        *_standoffs(field, target.places, follows),
        *_path(field, target.places, "target"),
        *_path(field, vehicle.places, "vehicle"),
        *_marks(field, vehicle.places, home),
        *_hovers(field, vehicle.places, "vehicle"),
        *_hovers(field, target.places, "target, as the station believed"),
        *_scale_bar(field),
    ]
    return svg("the flight from above", _WIDTH_PX, field.height_px, parts)


def is_in_sight(vehicle: Trail, target: Trail, fence: Fence) -> bool:
    """Whether any of the circle can be seen beside the paths."""
    field = _field([*vehicle.places, *target.places])
    corners_m = [
        math.hypot(
            field.north_m - y_px / field.px_per_m - fence.north_m, field.west_m + x_px / field.px_per_m - fence.east_m
        )
        for x_px in (0, _WIDTH_PX - 2 * _EDGE_PX)
        for y_px in (0, field.height_px - 2 * _EDGE_PX)
    ]
    return max(corners_m) > fence.radius_m or bool(fence.polygon_m)


def _field(places: Sequence[Place]) -> _Field:
    """Home, at 0, 0, is always in it where it is not very far off."""
    norths, easts = [p.north_m for p in places], [p.east_m for p in places]
    reach_m = max(max(norths) - min(norths), max(easts) - min(easts), _LEAST_SPAN_M)
    if math.hypot(min(map(abs, norths)), min(map(abs, easts))) < 2 * reach_m:
        norths, easts = [*norths, 0.0], [*easts, 0.0]
    margin_m = 0.08 * reach_m + 1.0
    south_m, north_m = min(norths) - margin_m, max(norths) + margin_m
    west_m, east_m = min(easts) - margin_m, max(easts) + margin_m
    wide_px, most_px = _WIDTH_PX - 2 * _EDGE_PX, _MOST_HEIGHT_PX - 2 * _EDGE_PX
    px_per_m = min(wide_px / (east_m - west_m), most_px / (north_m - south_m))
    height_px = max(round((north_m - south_m) * px_per_m) + 2 * _EDGE_PX, _LEAST_HEIGHT_PX)
    free_m = wide_px / px_per_m - (east_m - west_m), (height_px - 2 * _EDGE_PX) / px_per_m - (north_m - south_m)
    return _Field(west_m - free_m[0] / 2, north_m + free_m[1] / 2, px_per_m, height_px)


def _grid(field: _Field) -> Iterator[str]:
    right, bottom = _WIDTH_PX - _EDGE_PX, field.height_px - _EDGE_PX
    east_m = field.west_m + (right - _EDGE_PX) / field.px_per_m
    south_m = field.north_m - (bottom - _EDGE_PX) / field.px_per_m
    step = ticks(field.west_m, east_m, 8)
    width_m = step[1] - step[0] if len(step) > 1 else _LEAST_SPAN_M
    for value in step:
        x = field.px(0.0, value)[0]
        yield f'<path class="grid" d="M{x:.1f} {_EDGE_PX}V{bottom}"/>'
        yield f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">{number(value)}</text>'
    for index in range(math.ceil(south_m / width_m), math.floor(field.north_m / width_m) + 1):
        y = field.px(index * width_m, 0.0)[1]
        yield f'<path class="grid" d="M{_EDGE_PX} {y:.1f}H{right}"/>'
        yield f'<text x="{_EDGE_PX - 4}" y="{y + 4:.1f}" text-anchor="end">{number(index * width_m)}</text>'
    yield f'<text x="{right}" y="{field.height_px - 4}" text-anchor="end">m east of home</text>'
    yield f'<text x="4" y="14">m north</text><path class="mark" d="M{right} 30v-22l-5 9m5-9l5 9"/>'
    yield f'<text class="strong" x="{right - 10}" y="20" text-anchor="end">N</text>'


def _clip(field: _Field) -> str:
    """For what may reach beyond the picture."""
    wide_px, high_px = _WIDTH_PX - 2 * _EDGE_PX, field.height_px - 2 * _EDGE_PX
    rect = f'<rect x="{_EDGE_PX}" y="{_EDGE_PX}" width="{wide_px}" height="{high_px}"/>'
    return f'<clipPath id="field">{rect}</clipPath>'


def _fence(field: _Field, fence: Fence) -> Iterator[str]:
    """The circle, the polygon and the operator's distance, as far as they are within the picture."""
    circles = [(fence.north_m, fence.east_m, fence.radius_m, "fence")]
    if fence.operator_distance_m is not None:
        circles.append(
            (fence.operator_north_m, fence.operator_east_m, fence.operator_distance_m, "operator's distance")
        )
    for north_m, east_m, radius_m, name in circles:
        (x, y), radius_px = field.px(north_m, east_m), radius_m * field.px_per_m
        yield (
            f'<circle class="fence" clip-path="url(#field)" cx="{x:.1f}" cy="{y:.1f}" r="{radius_px:.1f}">'
            f"<title>{name}, {radius_m:g} m</title></circle>"
        )
    if fence.polygon_m:
        corners = " ".join("{:.1f},{:.1f}".format(*field.px(*corner)) for corner in fence.polygon_m)
        yield f'<polygon class="fence" clip-path="url(#field)" points="{corners}"><title>fence</title></polygon>'


def _path(field: _Field, places: Sequence[Place], who: str) -> Iterator[str]:
    """A piece for each stretch of one kind; the pieces meet."""
    pieces: list[tuple[str, list[Place]]] = []
    for before, place in pairwise(places):
        if place.t_s - before.t_s > 5.0 and who == "target":  # nobody was followed in between
            pieces.append((place.kind, [place]))
        elif pieces and pieces[-1][0] == place.kind and pieces[-1][1][-1] is before:
            pieces[-1][1].append(place)
        else:
            pieces.append((place.kind, [before, place]))
    for kind, piece in pieces:
        points = "L".join("{:.1f} {:.1f}".format(*field.px(p.north_m, p.east_m)) for p in piece)
        yield f'<path class="path {who} {kind}" d="M{points}"/>'


def _sights(field: _Field, vehicle: Sequence[Place], target: Sequence[Place]) -> Iterator[str]:
    """Who looked where and when: thin lines from vehicle to target."""
    step = max(len(target) // _SIGHTS, 1)
    at = 0
    for place in target[::step]:
        while at + 1 < len(vehicle) and vehicle[at + 1].t_s <= place.t_s:
            at += 1
        own = vehicle[at]
        (x1, y1), (x2, y2) = field.px(own.north_m, own.east_m), field.px(place.north_m, place.east_m)
        yield f'<path class="sight" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>'


def _standoffs(field: _Field, target: Sequence[Place], follows: Sequence[Follow]) -> Iterator[str]:
    """The circle the vehicle was to keep to, round the target's last place of each follow."""
    for follow in follows[-3:]:
        last = next((p for p in reversed(target) if follow.start_s <= p.t_s <= follow.end_s), None)
        if last is None or follow.standoff_m is None:
            continue
        (x, y), radius_px = field.px(last.north_m, last.east_m), follow.standoff_m * field.px_per_m
        title = f"standoff of {follow.standoff_m:.1f} m, round the target at {clock(last.t_s)}"
        yield (
            f'<circle class="standoff" clip-path="url(#field)" cx="{x:.1f}" cy="{y:.1f}" r="{radius_px:.1f}">'
            f"<title>{title}</title></circle>"
        )


def _marks(field: _Field, vehicle: Sequence[Place], home: bool) -> Iterator[str]:
    x, y = field.px(0.0, 0.0)
    name = "home" if home else "first position"
    yield f'<path class="mark" d="M{x - 6:.1f} {y:.1f}h12m-6-6v12"><title>{name}</title></path>'
    yield f'<text class="strong" x="{x + 8:.1f}" y="{y + 14:.1f}">{name}</text>'
    for place, name in ((vehicle[0], "start"), (vehicle[-1], "end")):
        x, y = field.px(place.north_m, place.east_m)
        yield f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="4"><title>{name}, {clock(place.t_s)}</title></circle>'
        yield f'<text x="{x - 7:.1f}" y="{y - 7:.1f}" text-anchor="end">{name}</text>'


def _hovers(field: _Field, places: Sequence[Place], who: str) -> Iterator[str]:
    for place in places[:: max(len(places) // _HOVERS, 1)]:
        x, y = field.px(place.north_m, place.east_m)
        title = f"{who}\n{clock(place.t_s)}\n{place.north_m:.1f} m north, {place.east_m:.1f} m east"
        yield f'<circle class="hover" cx="{x:.1f}" cy="{y:.1f}" r="7"><title>{escape(title)}</title></circle>'


def _scale_bar(field: _Field) -> Iterator[str]:
    most_m = 160 / field.px_per_m
    power = 10.0 ** math.floor(math.log10(most_m))
    length_m = next(power * factor for factor in (5, 2, 1) if power * factor <= most_m)
    x, y = _EDGE_PX + 8, _EDGE_PX + 16
    yield f'<path class="mark" d="M{x} {y - 4}v4h{length_m * field.px_per_m:.1f}v-4"/>'
    yield f'<text class="strong" x="{x + 4}" y="{y - 5}">{number(length_m)} m</text>'
