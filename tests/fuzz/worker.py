"""A process that tries damaged files one after the other, and says what became of each on a line of its own.

    python -m tests.fuzz.worker KIND SEED FIRST END

It says the number before it begins, so that whoever started it knows which one it died of.
"""

from __future__ import annotations

import faulthandler
import json
import random
import resource
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Protocol

from tests.fuzz.process import Case, Usage

_MEMORY_BYTES: Final = 6 << 30  # of addresses: a bomb shall end this process, not the machine


class Cases(Protocol):
    """One kind of damaged file."""

    def run(self, rng: random.Random) -> Case:
        """Make and try one."""
        ...

    def close(self) -> None:
        """Let go of everything."""
        ...


def _videos(folder: Path) -> Cases:
    from tests.fuzz.video_cases import VideoCases

    return VideoCases(folder)


def _weights(folder: Path) -> Cases:
    from tests.fuzz.weights_cases import WeightsCases

    return WeightsCases(folder)


def _flights(folder: Path) -> Cases:
    from tests.fuzz.flight_cases import FlightCases

    return FlightCases(folder)


KINDS: Final[dict[str, Callable[[Path], Cases]]] = {"videos": _videos, "weights": _weights, "flights": _flights}


def main(kind: str, seed: int, first: int, end: int) -> int:
    """Work through the numbers; 0."""
    faulthandler.enable()
    threading.excepthook = _thread_fault
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
    with tempfile.TemporaryDirectory() as name:
        cases = KINDS[kind](Path(name))
        for number in range(first, end):
            _say(begin=number)
            case = cases.run(random.Random(f"{seed} {number}"))
            _say(end=number, **asdict(case), **asdict(Usage.now()))
        cases.close()
    return 0


def _say(**values: Any) -> None:
    sys.stdout.write(json.dumps(values) + "\n")
    sys.stdout.flush()


def _thread_fault(fault: threading.ExceptHookArgs) -> None:
    name = fault.thread.name if fault.thread is not None else "?"
    _say(fault=f"{fault.exc_type.__name__} leaves thread {name}: {fault.exc_value}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:5])))
