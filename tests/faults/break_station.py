"""Faults of our own program, and its orderly end: H21 to H25, H35, H37."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from unittest import mock

from control.types import VelocityRequest
from gcs.recorder.message_log import MessageLog
from tests.faults.script import Happened
from tests.faults.world import FaultWorld


def requests_stale(world: FaultWorld) -> Happened:
    """The control law goes on giving out its last answer."""
    control = world.flight.control
    tick = world.flight.tick
    old = tick.request if tick is not None else None
    given: list[float] = []

    def stalled(*args: object) -> VelocityRequest:
        given.append(world.loop.time())
        stamp_s = old.t_s if old is not None else world.cause_s
        return VelocityRequest(stamp_s, (2.0, 0.0, 0.0) if old is None else old.velocity_ned_mps, 0.0)

    control._follow_law = stalled  # type: ignore[method-assign, assignment]
    return lambda: bool(given) or world.rested()


def law_raises(world: FaultWorld) -> Happened:
    """The control law raises: a programming error."""
    raised: list[float] = []

    def broken(*args: object) -> VelocityRequest:
        raised.append(world.loop.time())
        raise ZeroDivisionError("a fault of the law")

    world.flight.control._follow_law = broken  # type: ignore[method-assign, assignment]
    return lambda: bool(raised) or world.rested()


def long_stall(world: FaultWorld) -> Happened:
    """The whole process stands still for a quarter of a second to three seconds."""
    seconds = world.random.uniform(0.26, 3.0)
    start_s, before = world.loop.time(), len(world.exit.setpoints)
    world.stall(seconds)
    ended_s = world.loop.time()
    stalled = ended_s - start_s >= seconds - 0.02 and len(world.exit.setpoints) == before
    return lambda: stalled


def short_stall(world: FaultWorld) -> Happened:
    """Less than a tick or two: garbage collection, a busy machine."""
    start_s = world.loop.time()
    world.stall(world.random.uniform(0.03, 0.1))
    stalled = world.loop.time() > start_s
    return lambda: stalled


def killed(world: FaultWorld) -> Happened:
    """The program is gone from one moment to the next."""
    world.dead = True
    count = len(world.exit.setpoints)
    return lambda: len(world.exit.setpoints) == count


def leaves(world: FaultWorld) -> Happened:
    """The operator quits, or a signal ends the program in order."""
    world.flight.stop()
    return lambda: world.flight._stopping.is_set()


def clock_jumps(world: FaultWorld) -> Happened:
    """The wall clock jumps by an hour, either way, again and again."""
    real, jump_s = time.time, world.random.choice((-3600.0, 3600.0))
    asked: list[float] = []

    def wrong() -> float:
        asked.append(jump_s)
        return real() + jump_s * (len(asked) % 2)

    patch = mock.patch("time.time", wrong)
    patch.start()
    world.undo.append(patch.stop)
    jumped = abs(time.time() - real()) > 1000
    return lambda: jumped


class _FullDisk:
    """Takes nothing."""

    def write(self, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    def truncate(self, size: int) -> None:
        """There is nothing to take back."""

    def __enter__(self) -> _FullDisk:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class _Recorder:
    """A watcher that writes every tick to a real message log."""

    def __init__(self, log: MessageLog) -> None:
        self._log = log

    def ticked(self, tick: object) -> None:
        self._log.write(0.0, tick)

    def saw(self, sighting: object) -> None:
        """Not needed."""

    def audited(self, t_s: float, audit: object) -> None:
        """Not needed."""


def disk_full(world: FaultWorld) -> Happened:
    """The disk takes nothing more."""
    log = MessageLog(Path(tempfile.gettempdir()) / "never-made.jsonl", open_file=lambda path: _FullDisk())
    world.flight.watchers = (*world.flight.watchers, _Recorder(log))
    world.undo.append(log.close)

    def happened() -> bool:
        log.close()
        return log.problem is not None

    return happened


def operator_stops(world: FaultWorld) -> Happened:
    """The operator's abort."""
    world.flight.abort()
    return lambda: True
