"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gcs.doctor import machine, ports, software
from gcs.doctor.check import Check, Question, Result, Say, fail
from gcs.doctor.latency import latency
from gcs.errors import one_line


def _video(question: Question, say: Say) -> Iterator[Result]:
    from gcs.doctor.video import video  # OpenCV, when it is its turn

    yield from video(question, say)


def _vehicle(question: Question, say: Say) -> Iterator[Result]:
    from gcs.doctor.vehicle import vehicle  # MAVLink, when it is its turn

    yield from vehicle(question, say)


def _tracker(question: Question, say: Say) -> Iterator[Result]:
    from gcs.doctor.tracking import tracker

    yield from tracker(question, say)


CHECKS: Final[tuple[tuple[str, Check], ...]] = (
    ("python", software.python),
    ("packages", software.packages),
    ("extras", software.extras),
    ("cores", machine.cores),
    ("timing", machine.timing),
    ("disk", machine.disk),
    ("terminal", machine.terminal),
    ("browser", machine.browser),
    ("port of the page", ports.page_port),
    ("port of RTSP", ports.rtsp_port),
    ("port of the camera", ports.camera_port),
    ("port of the link", ports.vehicle_port),
    ("video", _video),
    ("vehicle", _vehicle),
    ("tracker", _tracker),
)


def diagnose(question: Question, say: Say, checks: tuple[tuple[str, Check], ...] = CHECKS) -> Iterator[Result]:
    """Each result as soon as it is there. say: what is being done."""
    measured = {}
    for name, check in checks:
        say(name)
        for result in _guarded(name, check, question, say):
            measured[result.name] = result.figures
            yield result
    yield latency(question, measured)


def _guarded(name: str, check: Check, question: Question, say: Say) -> Iterator[Result]:
    try:
        yield from check(question, say)
    except Exception as error:  # noqa: BLE001 - one check that breaks must not hide what the others find
        text = one_line(f"the check itself broke, {type(error).__name__}: {error}")
        yield fail(name, text, "please report this line")
