"""What a process tells of a damaged file, and of itself: memory, file handles, threads, from /proc."""

from __future__ import annotations

import os
import re
import threading
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import one_line


@dataclass(frozen=True, slots=True)
class Usage:
    """rss_mb: resident memory now; peak_mb: the most there ever was."""

    rss_mb: float
    peak_mb: float
    handles: int
    threads: int

    @classmethod
    def now(cls) -> Usage:
        """Linux only."""
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        peak_kb = re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())
        return cls(
            pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
            int(peak_kb.group(1)) / 1e3 if peak_kb else 0.0,
            len(os.listdir("/proc/self/fd")),
            threading.active_count(),
        )


@dataclass(frozen=True, slots=True)
class Case:
    """One damaged thing. worked: something could be read of it all the same. said: the error that a user gets.

    problem: what must not happen; empty if nothing did.
    """

    kind: str
    worked: bool
    said: str
    problem: str


def bad_line(text: str) -> str:
    """What is wrong with an error as a line for a user; empty if nothing is."""
    return "" if text and text == one_line(text) else f"not one line: {text[:300]!r}"
