"""One damaged flight after the other through everything that reads flights; for `tests.fuzz.worker`."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import io
import json
import random
import shutil
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import cv2

from gcs.cli.entry import build_parser, describe
from gcs.clock import FakeClock, MonotonicClock
from gcs.errors import GcsError
from gcs.operator.playback import Frames, Play, Seek, Speed
from gcs.operator.web import reports
from gcs.recorder.retention import removable, remove
from gcs.replay.lines import play_json, play_lines
from gcs.replay.player import Delivered, End, Player
from gcs.replay.recorded import Recorded, open_recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import glance
from tests.fuzz.flights import FILMS, INDEX, LOG, MANIFEST, NAME, TLOG, Seeds, damaged_flight
from tests.fuzz.process import Case, bad_line

_WATCHED: Final = (LOG, MANIFEST, INDEX, TLOG, *FILMS)
_TUNING: Final = "follow:\n  standoff_m: 9.5\n"
_PLAY_S: Final = 0.3

Reader = Callable[[Path, Path, random.Random], None]


class FlightCases:
    """Each in a folder of its own, beside a file that nobody may touch."""

    def __init__(self, folder: Path) -> None:
        cv2.setNumThreads(1)
        self._root = folder / "case"
        self._seeds = Seeds(folder / "seeds")
        self._warm_up(folder / "whole")

    def _warm_up(self, folder: Path) -> None:
        """Each way on a flight that is whole: it must work, and what it loads is no growth of the cases to come."""
        for name in _NAMES:
            flight, out = folder / name / NAME, folder / name / "out"
            shutil.copytree(self._seeds.folders[0], flight)
            out.mkdir()
            worked, said, problem = _read(name, flight, out, random.Random(1))
            if not worked and name != "over itself":
                raise RuntimeError(f"{name} of a whole flight: {said or problem}")

    def run(self, rng: random.Random) -> Case:
        """Damage one, then read it in two ways."""
        self._root.mkdir()
        outside, out = self._root / "outside.txt", self._root / "out"
        outside.write_text("as it was")
        out.mkdir()
        flight = self._root / NAME
        try:
            kind = damaged_flight(self._seeds, flight, rng)
            _trap(flight, outside, rng)
            before = _state(flight)
            worked, said, problem = False, "", ""
            for name in rng.sample(_NAMES if rng.random() < 0.2 else _QUICK, 2):
                done, said, problem = _read(name, flight, out, rng)
                worked |= done
                kind = f"{kind}; {name}"
                if not problem and outside.read_bytes() != b"as it was":
                    problem = "wrote outside of the folder"
                if not problem and (changed := _changed(before, flight)):
                    problem = f"changed {changed}"
                if problem:
                    break
        finally:
            shutil.rmtree(self._root)
            _trim()
        return Case(kind, worked, said, problem)

    def close(self) -> None:
        """Nothing is open."""


def _trim() -> None:
    """What the threads of encoders have let go of goes back at once, so that growth is growth."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def _trap(flight: Path, outside: Path, rng: random.Random) -> None:
    """Where something will be written: a link that leads out, or a folder."""
    name = rng.choice(("report.html", "flight.mcap", "flight.mcap.new", "with-tuning.png", "manifest.json.new", ""))
    if name and rng.random() < 0.3:
        if rng.random() < 0.7:
            (flight / name).symlink_to(outside)
        else:
            (flight / name).mkdir()


def _state(flight: Path) -> dict[str, tuple[int, int, int]]:
    found = {}
    for name in _WATCHED:
        with contextlib.suppress(OSError):
            entry = (flight / name).lstat()
            found[name] = entry.st_ino, entry.st_size, entry.st_mtime_ns
    return found


def _changed(before: dict[str, tuple[int, int, int]], flight: Path) -> str:
    if not flight.exists():  # retention has removed all of it
        return ""
    after = _state(flight)
    return ", ".join(name for name in {**before, **after} if before.get(name) != after.get(name))


def _read(name: str, flight: Path, out: Path, rng: random.Random) -> tuple[bool, str, str]:
    """(whether it came to something, the error as its user gets it, what must not have happened)."""
    written, told = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(written), contextlib.redirect_stderr(told):
            _READERS[name](flight, out, rng)
    except Exception as error:  # noqa: BLE001 - this is what is looked for
        said, _ = describe(error)
        if isinstance(error, GcsError) or not said.startswith("internal fault"):
            return False, said, bad_line(said)
        where = traceback.extract_tb(error.__traceback__)[-1]
        return False, "", f"{name}: {said} ({Path(where.filename).name}:{where.lineno})"
    return True, "", _bad_output(name, written.getvalue(), told.getvalue())


def _bad_output(name: str, text: str, told: str) -> str:
    bad = {char for char in text + told if not char.isprintable() and char != "\n"}
    if bad:
        return f"{name}: prints {sorted(bad)!r}"
    if name.endswith("--json"):
        for line in text.splitlines():
            try:
                json.loads(line)
            except ValueError:
                return f"{name}: no JSON: {line[:200]!r}"
    return ""


# -- everything that reads flights -------------------------------------------------------------------------


def _command(*args: str) -> None:
    parsed = build_parser().parse_args(args)
    module, _, function = parsed.handler.partition(":")
    getattr(importlib.import_module(module), function)(parsed)


def _just(*args: str) -> Reader:
    """A command; FLIGHT, HERE (the folder it is in) and OUT stand for them."""

    def read(flight: Path, out: Path, rng: random.Random) -> None:
        places = {"FLIGHT": str(flight), "HERE": str(flight.parent), "OUT/f.mp4": str(out / "f.mp4")}
        _command(*(places.get(arg, arg) for arg in args))

    return read


def _lines(flight: Path, out: Path, rng: random.Random) -> None:
    _play(flight, play_lines)


def _json_lines(flight: Path, out: Path, rng: random.Random) -> None:
    _play(flight, play_json)


def _play(flight: Path, play: Callable[..., None]) -> None:
    clock = FakeClock(5000.0)

    def sleep(seconds: float) -> None:
        if not 0 <= seconds <= threading.TIMEOUT_MAX:
            raise OverflowError(f"a sleep of {seconds:g} s")
        clock.advance(seconds)

    with _opened(flight) as recorded:
        play(recorded, 20.0, print, clock, sleep)


@contextlib.contextmanager
def _opened(flight: Path) -> Iterator[Recorded]:
    recorded = open_recorded(flight)
    with contextlib.closing(recorded.film):
        yield recorded


def _page(flight: Path, out: Path, rng: random.Random) -> None:
    """What the page is told, while somebody steers wildly."""
    with _opened(flight) as recorded:
        _steer(recorded, rng)


def _steer(recorded: Recorded, rng: random.Random) -> None:
    station, ended = ReplayStation(recorded, glance(recorded)), threading.Event()
    faults: list[Exception] = []

    def take(delivered: Delivered) -> None:
        if isinstance(delivered, End):
            ended.set()
        try:
            station.deliver(delivered)
            _tell(station)
        except Exception as error:  # noqa: BLE001 - on the loop it would be the page's
            faults.append(error)

    reports.timeline_report(station).encode()
    player = station.player = Player(recorded, MonotonicClock(), 20.0, take)
    player.start()
    span_s = recorded.log.span_s
    for _ in range(6):
        station.steer(
            rng.choice(
                (Seek(rng.uniform(0, span_s)), Seek(rng.choice((-1e300, 1e300, 0.0, float("nan")))),
                 Frames(rng.choice((-1, 1, 5, 10**12, -(10**12)))), Play(), Play(True), Speed(rng.choice((0.1, 20.0))))
            )
        )  # fmt: skip
        time.sleep(_PLAY_S / 6)
    ended.wait(_PLAY_S)
    player.close()
    if player._thread.is_alive():
        raise RuntimeError("the player does not end")
    if faults:
        raise faults[0]


def _tell(station: ReplayStation) -> None:
    for report in (
        reports.status_report(station, "", 1), reports.map_report(station.scene()), reports.playhead_report(station)
    ):  # fmt: skip
        report.encode()
    if station.player is not None and (newest := station.frames.newest) is not None:
        assert newest.image_bgr.ndim == 3


def _with(flight: Path, out: Path, rng: random.Random) -> None:
    (out / "tuning.yaml").write_text(_TUNING)
    _command("replay", str(flight), "--with", str(out / "tuning.yaml"), "--from", "control")


def _report(flight: Path, out: Path, rng: random.Random) -> None:
    _command("report", str(flight))
    text = (flight / "report.html").read_text()
    for bad in ("<script", "<img src=x", "onerror='"):
        if bad in text.lower():
            raise RuntimeError(f"the page holds {bad}")


def _export(flight: Path, out: Path, rng: random.Random) -> None:
    target = () if rng.random() < 0.5 else ("--mcap", str(out / "x.mcap"))
    _command("export", str(flight), *target)


def _over_itself(flight: Path, out: Path, rng: random.Random) -> None:
    """Onto a file of the record: what was recorded stays."""
    name = str(flight / rng.choice(_WATCHED))
    args = rng.choice((("export", "--mcap"), ("report", "--html"), ("replay", "--film")))
    _command(args[0], str(flight), args[1], name)


def _import(flight: Path, out: Path, rng: random.Random) -> None:
    video: tuple[str, ...] = ()
    if rng.random() < 0.3:
        video = ("--video", str(flight / rng.choice(FILMS)), "--offset=" + rng.choice(("0", "1e9", "-1e9", "1e300")))
    _command("import", str(flight / TLOG), "--out", str(out / "imported"), *video)


def _retention(flight: Path, out: Path, rng: random.Random) -> None:
    for kept in removable(flight.parent):
        assert kept.path == flight
        remove(kept.path)


_READERS: Final[dict[str, Reader]] = {
    "replay --no-page": _lines, "replay --json": _json_lines, "replay, page": _page,
    "--film": _just("replay", "FLIGHT", "--film", "OUT/f.mp4"), "--with": _with,
    "--verify --from control --json": _just("replay", "FLIGHT", "--verify", "--from", "control", "--json"),
    "report": _report, "report --json": _just("report", "FLIGHT", "--json"), "export": _export,
    "over itself": _over_itself, "import": _import, "flights": _just("flights", "--folder", "HERE"),
    "flights --json": _just("flights", "--json", "--folder", "HERE"), "retention": _retention,
    "--verify": _just("replay", "FLIGHT", "--verify"),
}  # fmt: skip
_NAMES: Final = tuple(_READERS)
_QUICK: Final = _NAMES[:-1]  # PyTorch takes a second
