"""What stands on the terminal, in every size and state."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from rich.cells import cell_len
from rich.color import ColorSystem

from control.engagement import State
from gcs.candidates import Candidate
from gcs.flight_view import Status
from gcs.operator.terminal_hud import View, render, where
from tests.gcs.fake_station import FakeStation
from tracker.box import Box

SGR = re.compile(r"\x1b\[[\d;]*m")
BOX = Box(100.0, 400.0, 30.0, 60.0)


def status() -> Status:
    base = FakeStation(now_s=lambda: 100.0).status()
    return replace(base, state=State.FOLLOWING, selection=1, confidence=0.87, distance_m=15.4, standoff_m=15.0)


def lines(view: View, columns: int = 80, rows: int = 24, colours: ColorSystem | None = None) -> list[str]:
    return [SGR.sub("", line) for line in render(view, columns, rows, colours)]


def test_everything_fits_the_smallest_usual_terminal() -> None:
    full = replace(
        status(),
        reasons=("target lost", "video is late"),
        warnings=("nothing is heard of the vehicle",),
        limited_by=("speed", "fence"),
    )
    candidates = tuple(Candidate(n, BOX) for n in range(1, 5))
    view = View(full, (640, 480), "SIM", BOX, candidates=candidates, controller="page 2", typed="f")
    text = "\n".join(shown := lines(view))
    assert len(shown) <= 21  # room for what is said
    for part in (
        "FOLLOWING: target lost", "video is late", "SIM", "page 2 in control", "! nothing is heard", "speed, fence",
        "left, low 30x60 px", "0.87", "15.4 m of 15.0 m wanted (+0.4)", "follow", "hold · armed · 10.0 m high",
        "battery 83%", "145 ms", "glass 100", "tracker 20", "in 8.1 out 1.9 kB/s", "heartbeat 0.", "video never",
        "4 left, low 30x60 px at 16% 83%", "space or Esc ABORT", "f Enter follow", "> f",
    ):  # fmt: skip
        assert part in text, part


@pytest.mark.parametrize(("columns", "rows"), [(20, 4), (30, 8), (60, 12), (80, 24), (120, 40), (300, 100)])
def test_nothing_is_wider_or_higher_than_the_terminal(columns: int, rows: int) -> None:
    warnings = tuple(f"warning {i} " + "long " * 60 for i in range(10))
    view = View(replace(status(), warnings=warnings), (640, 480), "DRY RUN", BOX, typed="box " * 40)
    shown = lines(view, columns, rows)
    assert len(shown) < rows
    assert max(map(cell_len, shown)) < columns
    text = "\n".join(shown)
    assert "FOLLOWING" in text
    assert "ABORT" in text or columns == 20
    assert shown[-1].startswith("> box")


def test_every_refusal_is_listed_before_confirming_and_none_after() -> None:
    refusals = ("not armed", "no position", "too near", "fence not known")
    view = View(replace(status(), state=State.SELECTED), (640, 480), refusals=refusals)
    assert all(refusal in "\n".join(lines(view)) for refusal in refusals)
    assert "not armed" not in "\n".join(lines(replace(view, status=status())))


def test_what_a_vehicle_says_cannot_steer_the_terminal() -> None:
    view = View(replace(status(), warnings=("\x1b[2Jgone\r\n\x07",)), (640, 480))
    for colours in (None, ColorSystem.TRUECOLOR):
        text = "".join(render(view, 80, 24, colours))
        assert "gone" in text
        assert "\x1b[2J" not in text
        assert not set("\r\n\x07") & set(text)


def test_without_colours_the_state_still_stands_out() -> None:
    (banner,) = (line for line in render(View(status(), (640, 480)), 80, 24, None) if "FOLLOWING" in line)
    assert "\x1b[1;7m" in banner
    assert not re.search(r"\x1b\[[\d;]*3\d", banner)
    coloured = render(View(status(), (640, 480)), 80, 24, ColorSystem.STANDARD)
    assert any("FOLLOWING" in line and re.search(r"\x1b\[[\d;]*32m", line) for line in coloured)


def test_old_telemetry_is_an_alarm() -> None:
    vehicle = replace(status().vehicle, attitude_t_s=98.0)
    shown = render(View(replace(status(), vehicle=vehicle), (640, 480)), 80, 24, ColorSystem.STANDARD)
    (ages,) = (line for line in shown if "heartbeat" in line)
    assert "\x1b[1;31m2.0" in ages
    assert "\x1b[1;31m0.1" not in ages


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [(0.5, 0.5, "middle"), (0.05, 0.5, "far left"), (0.3, 0.9, "left, low"), (0.5, 0.1, "high"),
     (0.9, 0.5, "far right"), (0.7, 0.8, "right, low")],
)  # fmt: skip
def test_where_in_words(x: float, y: float, words: str) -> None:
    assert where(Box(x * 640, y * 480, 34, 60), (640, 480)) == f"{words} 34x60 px"


def test_unknown_things_are_named_so() -> None:
    unknown = replace(status(), confidence=None, distance_m=None, standoff_m=None, budget=None, frame_t_s=None)
    text = "\n".join(lines(View(unknown, (640, 480))))
    assert "not seen" in text
    assert "not known" in text
    assert "not measured" in text
    assert "nan" not in text
    assert not math.isnan(status().t_s)
