"""When a run has to leave: its slice of time, and signals."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

FIRST_EXAMINATION_S = 30.0  # what an examination is thought to take until one was timed


def process_age_s() -> float:
    """Seconds since this process was started (0 where the system does not say): importing PyTorch counts too."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        uptime_s = float(Path("/proc/uptime").read_text().split()[0])
        return max(0.0, uptime_s - ticks / os.sysconf("SC_CLK_TCK"))
    except (OSError, ValueError, IndexError):
        return 0.0


class Slice:
    """The time a run may take; knows how long leaving takes, from what was measured on the way.

    end_s: on the clock of time.monotonic.
    """

    def __init__(self, end_s: float) -> None:
        self.end_s = end_s
        self.step_s, self.save_s, self.examination_s = 0.0, 1.0, FIRST_EXAMINATION_S

    @classmethod
    def of(cls, minutes: float) -> Slice:
        """From the start of the process."""
        return cls(time.monotonic() - process_age_s() + minutes * 60)

    def over(self, now_s: float) -> bool:
        """Whether to leave now: another step, the checkpoint and the export would else end too late."""
        return now_s + self.step_s + self._leaving_s() > self.end_s

    def holds_examination(self, now_s: float) -> bool:
        """Whether an examination, and leaving, fit in what is left."""
        return now_s + 1.2 * self.examination_s + self._leaving_s() <= self.end_s

    def _leaving_s(self) -> float:
        return 2.0 + 4.0 * self.save_s  # the checkpoint, the export that reads it and writes, a margin


class Interruption:
    """`with Interruption() as asked:` notes SIGTERM and Ctrl-C in asked.stop; a second one acts as ever."""

    SIGNALS = (signal.SIGTERM, signal.SIGINT)

    def __init__(self) -> None:
        self.stop = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = {s: signal.signal(s, self._note) for s in self.SIGNALS}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._restore()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.stop = True
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}
