"""The computer: cores and their punctuality, disk, screens."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gcs.doctor.check import Question, Result, Say, fail, ok, skip, warn
from gcs.recorder.facts import usable_cores

_TICK_S: Final = 0.05  # of the control task
_TICKS: Final = 20
_LATE_WARN_S: Final = 0.02
_LATE_FAIL_S: Final = 0.15  # a little less than what releases a follow
_GB: Final = 1e9
_LITTLE_GB, _HARDLY_GB = 5.0, 0.3
_BROWSERS: Final = ("firefox", "chromium", "chromium-browser", "google-chrome", "microsoft-edge", "brave-browser")


def cores(question: Question, _say: Say) -> Iterator[Result]:
    """How many we may use, and whether others use them."""
    count = usable_cores()
    threads = question.config.tracker.threads
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    text = f"{count} to use, load {load:.1f}"
    figures = {"cores": float(count), "load": load}
    if threads is not None and threads > count:
        fix = f"set tracker.threads to {count} or leave it out"
        yield warn("cores", f"{text}; tracker.threads is {threads}", fix, **figures)
    elif count < 2:
        yield warn(
            "cores", text, "with one core the tracker and the page wait for each other: use two or more", **figures
        )
    elif load > count:
        yield warn("cores", f"{text}: others use them", "end other programs before a flight (see `top`)", **figures)
    else:
        yield ok("cores", text, **figures)


def timing(_question: Question, _say: Say) -> Iterator[Result]:
    """How late a task that is due 20 times a second is woken here."""
    late_s = 0.0
    for _ in range(_TICKS):
        due_s = time.monotonic() + _TICK_S
        time.sleep(_TICK_S)
        late_s = max(late_s, time.monotonic() - due_s)
    yield judge_timing(late_s)


def judge_timing(late_s: float) -> Result:
    """What it means."""
    text = f"the 20 Hz control task would be woken at most {1000 * late_s:.0f} ms late"
    fix = "end other programs, switch off power saving, give a virtual machine cores of its own"
    if late_s > _LATE_FAIL_S:
        return fail("timing", text, fix, late_s=late_s)
    return warn("timing", text, fix, late_s=late_s) if late_s > _LATE_WARN_S else ok("timing", text, late_s=late_s)


def disk(question: Question, _say: Say) -> Iterator[Result]:
    """Whether a recording can be written, and for how long."""
    recorder = question.config.recorder
    folder = Path(recorder.folder)
    there = next((each for each in (folder.absolute(), *folder.absolute().parents) if each.exists()), Path("/"))
    if not there.is_dir():
        yield fail("disk", f"{there} is a file", "set recorder.folder to a folder, or --out")
        return
    if not os.access(there, os.W_OK | os.X_OK):
        yield fail("disk", f"{there} cannot be written to", "set recorder.folder to a folder of yours, or --out")
        return
    free_gb = shutil.disk_usage(there).free / _GB
    text = f"{folder}: {free_gb:.1f} GB free"
    if free_gb < _HARDLY_GB:
        yield fail("disk", text, "make room: the recording of a flight would stop", free_gb=free_gb)
    elif free_gb < _LITTLE_GB:
        yield warn("disk", text, "make room: an hour of flight takes up to some GB", free_gb=free_gb)
    else:
        yield ok("disk", text, free_gb=free_gb)


def browser(question: Question, _say: Say) -> Iterator[Result]:
    """Something that can show the page."""
    page = question.config.page
    if not page.enabled:
        yield skip("browser", "the page is switched off")
        return
    found = next((name for name in _BROWSERS if shutil.which(name)), None)
    has_screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) or sys.platform != "linux"
    if found and has_screen:
        yield ok("browser", found)
    elif page.host in ("127.0.0.1", "localhost", "::1"):
        here = "no screen" if found else "no browser"
        fix = f"from another machine: ssh -L {page.port}:127.0.0.1:{page.port} THIS-MACHINE, or page.host: 0.0.0.0"
        yield warn("browser", f"{here} here, and the page is for this machine alone ({page.host})", fix)
    else:
        yield ok("browser", f"the page is served to the network ({page.host})")


def terminal(_question: Question, _say: Say) -> Iterator[Result]:
    """Whether keys and the full-screen display work here."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        yield skip("terminal", "none: keys and the full-screen display need one")
        return
    columns, lines = shutil.get_terminal_size()
    kind = os.environ.get("TERM", "")
    if kind in ("", "dumb") or columns < 80 or lines < 24:
        text = f"{kind or 'unknown'}, {columns} x {lines}"
        yield warn("terminal", text, "make it 80 x 24 or larger for the full-screen display, or use --plain")
    else:
        yield ok("terminal", f"{kind}, {columns} x {lines}")
