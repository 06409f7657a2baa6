"""This process, measured from /proc: memory, file handles, threads."""

from __future__ import annotations

import os
import re
import threading
from dataclasses import dataclass
from pathlib import Path


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
