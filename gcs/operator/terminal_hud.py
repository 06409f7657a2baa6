"""What stands on a terminal during a flight, as lines: pure, for any size, in colours or without."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

from rich.cells import cell_len, set_cell_size
from rich.color import ColorSystem
from rich.style import Style

from control.engagement import State
from gcs.candidates import Candidate
from gcs.errors import one_line
from gcs.flight_view import Status
from gcs.hud import Tone
from tracker.box import Box

_TONES: Mapping[Tone, str] = MappingProxyType(
    {
        Tone.CALM: "bold reverse",
        Tone.GOOD: "bold reverse green",
        Tone.CAUTION: "bold reverse yellow",
        Tone.ALARM: "bold reverse red",
    }
)
_LABEL, _PLAIN, _GOOD, _CAUTION, _ALARM, _KEY = "dim", "", "green", "yellow", "bold red", "bold"
_BAR: Final = 10
_MOST_CANDIDATES: Final = 9
_LOW_CONFIDENCE: Final = 0.5
_LOW_BATTERY: Final = 0.25
_OLD_S: Final = 1.0
_LABEL_COLUMNS: Final = 11
_LEFT_FREE: Final = 4  # rows for what is said

KEYS: Final = " space or Esc ABORT · f Enter follow · 1-9 pick · c things · d Enter drop"
MORE_KEYS: Final = " m Enter mode · [ ] nearer, farther · a Enter ack · r Enter film · q Enter quit"

Line: TypeAlias = tuple[tuple[str, str], ...]  # text and its style, piece by piece


@dataclass(frozen=True, slots=True)
class View:
    """All that is shown. size: of the picture, px. box: the tracker's, None where nothing is seen.

    candidates: None: nobody asked. controller: who is in control, as people are told. typed: not yet entered. asked: a
    question that the next keys answer.
    """

    status: Status
    size: tuple[int, int]
    watermark: str | None = None
    box: Box | None = None
    refusals: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] | None = None
    controller: str = ""
    typed: str = ""
    asked: str = ""


def render(view: View, columns: int, rows: int, colours: ColorSystem | None) -> list[str]:
    """Lines for a terminal, the most important ones where not all fit, each narrower than `columns`."""
    ranked = list(_ranked(view, columns))
    most = max(2, rows - min(_LEFT_FREE, rows // 4))
    kept = sorted(range(len(ranked)), key=lambda index: (ranked[index][0], index))[:most]
    return [_painted(ranked[index][1], columns - 1, colours) for index in sorted(kept)]


def where(box: Box, size: tuple[int, int]) -> str:
    """In words where it is in the picture, and how large it is there."""
    x, y = box.cx_px / size[0], box.cy_px / size[1]
    across = (
        "far left" if x < 0.15 else "left" if x < 0.4 else "" if x <= 0.6 else "right" if x <= 0.85 else "far right"
    )
    upright = "high" if y < 1 / 3 else "low" if y > 2 / 3 else ""
    place = ", ".join(word for word in (across, upright) if word) or "middle"
    return f"{place} {box.w_px:.0f}x{box.h_px:.0f} px"


def _ranked(view: View, columns: int) -> Iterable[tuple[int, Line]]:
    """Every line with its rank, 0 the last to be left out, from top to bottom."""
    status = view.status
    tone = _TONES[status.tone]
    padding = ((" " * (columns - 1), tone),)
    yield 5, padding
    yield 0, _banner(view, columns, tone)
    yield 5, padding
    yield from _listed("because", status.reasons[1:], _PLAIN)
    yield from _listed("warning", tuple(f"! {warning}" for warning in status.warnings), _ALARM)
    if status.state is State.SELECTED:
        yield from _listed("no follow", view.refusals, _CAUTION)
    yield 1, _target(view)
    yield 2, _distance(status)
    if status.limited_by:
        yield 2, _line("limited", (", ".join(status.limited_by), _CAUTION))
    yield 2, _vehicle(status)
    yield 3, _latency(status)
    yield 3, _ages(status)
    yield 4, _line("link", (" · ".join(part for part in (status.link, status.way) if part) or "-", _PLAIN))
    if view.candidates is not None:
        yield from ((3, line) for line in _things(view.candidates, view.size, columns))
    yield 4, ((MORE_KEYS, _LABEL),)
    yield 0, ((KEYS, _KEY),)
    yield 0, _prompt(view)


def _banner(view: View, columns: int, tone: str) -> Line:
    notes = [view.watermark or ""]
    if view.status.recording:
        notes.append("film")
    notes.append(f"{view.controller} in control" if view.controller else "nobody in control")
    right = " · ".join(note for note in notes if note) + " "
    left = " " + one_line(view.status.headline)
    room = columns - 1 - cell_len(right)
    if room < cell_len(left) + 1:  # the state is what counts
        return ((set_cell_size(left, columns - 1), tone),)
    return ((set_cell_size(left, room), tone), (right, tone))


def _target(view: View) -> Line:
    status = view.status
    if status.selection == 0:
        return _line("target", ("nothing is selected", _LABEL))
    if status.confidence is None or view.box is None:
        place = ("not seen", _CAUTION)
    else:
        place = (where(view.box, view.size), _PLAIN)
    if status.confidence is None:
        return _line("target", place)
    filled = round(min(max(status.confidence, 0.0), 1.0) * _BAR)
    colour = _GOOD if status.confidence >= _LOW_CONFIDENCE else _CAUTION
    bar = "█" * filled + "░" * (_BAR - filled)
    return _line("target", place, ("  confidence ", _LABEL), (f"{bar} {status.confidence:.2f}", colour))


def _distance(status: Status) -> Line:
    parts = [(f"{status.distance_m:.1f} m" if status.distance_m is not None else "not known", _PLAIN)]
    if status.standoff_m is not None:
        parts.append((f" of {status.standoff_m:.1f} m wanted", _PLAIN))
        if status.distance_m is not None:
            parts.append((f" ({status.distance_m - status.standoff_m:+.1f})", _PLAIN))
    return _line("distance", *parts, ("  mode ", _LABEL), (status.follow_mode.value, _PLAIN))


def _vehicle(status: Status) -> Line:
    vehicle = status.vehicle
    parts = [vehicle.mode.value, "armed" if vehicle.armed else "disarmed"]
    if vehicle.position_t_s is not None:
        parts += [f"{vehicle.height_m:.1f} m high", f"{math.hypot(*vehicle.velocity_ned_mps):.1f} m/s"]
    shown = [(" · ".join(parts), _PLAIN)]
    if vehicle.failsafe:
        shown.append((" · FAILSAFE", _ALARM))
    if vehicle.battery_frac is not None:
        low = vehicle.battery_frac < _LOW_BATTERY
        shown.append((f" · battery {vehicle.battery_frac:.0%}", _ALARM if low else _PLAIN))
    return _line("vehicle", *shown)


def _latency(status: Status) -> Line:
    if status.budget is None:
        return _line("latency", ("not measured", _LABEL))
    return _line("latency", (f"{status.budget.total_s * 1000:.0f} ms", _PLAIN), (f"  {status.budget.parts_ms}", _LABEL))


def _ages(status: Status) -> Line:
    """How old is what is known; old is red."""
    vehicle = status.vehicle
    parts: list[tuple[str, str]] = []
    for name, t_s in (
        ("video", status.frame_t_s),
        ("heartbeat", vehicle.heartbeat_t_s),
        ("attitude", vehicle.attitude_t_s),
        ("position", vehicle.position_t_s),
    ):
        age_s = math.inf if t_s is None else max(status.t_s - t_s, 0.0)
        limit_s = 3 * _OLD_S if name == "heartbeat" else _OLD_S
        shown = "never" if t_s is None else f"{age_s:.1f}" if age_s < 100 else ">99"
        parts += [(f"{name} ", _LABEL), (f"{shown}  ", _ALARM if age_s > limit_s else _PLAIN)]
    return _line("age in s", *parts, (f"{status.video_fps:.0f} fps", _PLAIN))


def _things(candidates: tuple[Candidate, ...], size: tuple[int, int], columns: int) -> list[Line]:
    if not candidates:
        return [_line("things", ("looking for what moves ...", _LABEL))]
    cells = [
        f"{each.number} {where(each.box, size)} at {each.box.cx_px / size[0]:.0%} {each.box.cy_px / size[1]:.0%}"
        for each in candidates[:_MOST_CANDIDATES]
    ]
    width = max(map(cell_len, cells)) + 3
    across = max(1, (columns - 1 - _LABEL_COLUMNS) // width)
    rows = [cells[start : start + across] for start in range(0, len(cells), across)]
    return [
        _line("things" if index == 0 else "", ("".join(cell.ljust(width) for cell in row), _PLAIN))
        for index, row in enumerate(rows)
    ]


def _prompt(view: View) -> Line:
    if view.asked:
        return ((f"? {view.asked}", _CAUTION),)
    if not view.typed:
        return (("> ", _LABEL),)
    hint = "   Enter: follow" if view.typed.strip(" :").lower() in ("f", "follow") else ""
    return ((f"> {view.typed}", _KEY), (hint or "   Enter; Esc aborts", _LABEL))


def _listed(label: str, texts: tuple[str, ...], style: str) -> Iterable[tuple[int, Line]]:
    """One line each; the first ones are the last to be left out."""
    for index, text in enumerate(texts):
        yield min(1 + index, 4), _line(label if index == 0 else "", (text, style))


def _line(label: str, *pieces: tuple[str, str]) -> Line:
    return ((f" {label}".ljust(_LABEL_COLUMNS), _LABEL), *pieces)


def _painted(line: Line, width: int, colours: ColorSystem | None) -> str:
    """Cut to the width, in the terminal's own colours."""
    shown, room = [], width
    for text, style in line:
        clean = one_line(text) if not text.isprintable() else text
        if cell_len(clean) > room:
            clean = set_cell_size(clean, room - 1) + "…" if room > 1 else ""
        room -= cell_len(clean)
        look = Style.parse(style)
        if colours is None:  # bold and reverse are no colours
            look = look.without_color
        shown.append(look.render(clean, color_system=colours or ColorSystem.STANDARD))
        if room <= 0:
            break
    return "".join(shown)
