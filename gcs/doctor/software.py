"""Python, the packages it needs and those it can use besides."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Final

from packaging.requirements import InvalidRequirement, Requirement

from gcs.doctor.check import Question, Result, Say, fail, ok, skip, warn

_PACKAGE: Final = "climrt-gcs"
_OLDEST: Final = (3, 11)
_EXTRAS: Final = {
    "video": "less delay on streams, and video out (RTSP, RTP)",
    "webrtc": "video in the browser as WebRTC instead of single pictures",
    "serial": "a radio or autopilot on a serial port",
}


def python(_question: Question, _say: Say) -> Iterator[Result]:
    """Its version."""
    text = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info < _OLDEST:
        yield fail("python", f"{text} is too old", "make a virtual environment with Python 3.11 or newer")
    else:
        yield ok("python", text)


def packages(question: Question, _say: Say) -> Iterator[Result]:
    """Whether what is required is there, and as it was tested."""
    wrong = problems(_requirements(""))
    if wrong:
        yield fail("packages", "; ".join(wrong), f"pip install --force-reinstall {_PACKAGE}, or `make setup`")
        return
    pinned = _pinned(question.source)
    other = [
        f"{name} {have}, tested with {want}"
        for name, want in pinned.items()
        # torch 2.13.0+cpu is 2.13.0
        if (have := installed(name)) is not None and not Requirement(f"x=={want}").specifier.contains(have)
    ]
    if other:
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        text = f"other versions than tested: {', '.join(other[:3])}{more}"
        yield warn("packages", text, "`make setup` installs what constraints.txt pins")
    else:
        yield ok("packages", f"{len(pinned)} as tested" if pinned else "all that is required is there")


def extras(question: Question, _say: Say) -> Iterator[Result]:
    """Which are installed; those that the configuration needs must be."""
    needed = _needed(question)
    for name, use in _EXTRAS.items():
        missing = problems(_requirements(name))
        fix = f"pip install '{_PACKAGE}[{name}]'"
        if not missing:
            yield ok(f"extra {name}", f"installed: {use}")
        elif name in needed:
            yield fail(f"extra {name}", f"not installed, but {needed[name]} needs it", fix)
        else:
            yield skip(f"extra {name}", f"not installed ({fix}); for {use}")


def _needed(question: Question) -> dict[str, str]:
    """Extra -> who asks for it."""
    needed = {}
    if question.config.video_out.rtsp_port is not None or question.config.video_out.rtp is not None:
        needed["video"] = "video_out"
    if question.vehicle is not None and question.vehicle.startswith("serial:"):
        needed["serial"] = question.vehicle
    return needed


def installed(name: str) -> str | None:
    """Its version, None if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def problems(wanted: list[Requirement]) -> list[str]:
    """What is missing or of a version that will not do."""
    found = []
    for requirement in wanted:
        have = installed(requirement.name)
        if have is None:
            found.append(f"{requirement.name} is missing")
        elif not requirement.specifier.contains(have, prereleases=True):
            found.append(f"{requirement.name} {have} is installed, {requirement.specifier} is needed")
    return found


def _requirements(extra: str) -> list[Requirement]:
    """Of the base installation for "", or of an extra alone."""
    try:
        lines = requires(_PACKAGE) or []
    except PackageNotFoundError:  # run from a folder, never installed
        return []
    parsed = [Requirement(line) for line in lines]
    base = [each for each in parsed if each.marker is None or each.marker.evaluate({"extra": ""})]
    if not extra:
        return base
    return [each for each in parsed if each not in base and each.marker and each.marker.evaluate({"extra": extra})]


def _pinned(source: Path | None) -> dict[str, str]:
    """name -> version of constraints.txt, for what is installed here; empty outside a checkout."""
    path = source / "constraints.txt" if source is not None else None
    if path is None or not path.is_file():
        return {}
    pins = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            requirement = Requirement(line.partition("#")[0].strip())
        except InvalidRequirement:
            continue
        exact = [each.version for each in requirement.specifier if each.operator == "=="]
        if exact and installed(requirement.name) is not None:
            pins[requirement.name] = exact[0]
    return pins
