"""What a long run may not let grow: memory, file handles, threads; and its trend."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Sample:
    """A process at one moment; t_s: of the flight. tasks: of asyncio, 0 where nobody can count them."""

    t_s: float
    rss_mb: float
    handles: int
    threads: int
    tasks: int = 0


def sample(t_s: float, pid: int | None = None, tasks: int = 0) -> Sample:
    """Of this process or that one; OSError once it is gone."""
    folder = Path("/proc") / ("self" if pid is None else str(pid))
    pages = int((folder / "statm").read_text().split()[1])
    handles = len(os.listdir(folder / "fd"))
    return Sample(t_s, pages * _PAGE_BYTES / 1e6, handles, len(os.listdir(folder / "task")), tasks)


def slope_mb_per_h(samples: list[Sample]) -> float:
    """Of memory over the flight's time, by least squares; 0 for fewer than three samples."""
    if len(samples) < 3:
        return 0.0
    hours = np.array([s.t_s for s in samples]) / 3600
    return float(np.polyfit(hours, [s.rss_mb for s in samples], 1)[0])


def growth(samples: list[Sample]) -> dict[str, tuple[int, int]]:
    """Smallest and largest count of what must stay the same."""
    return {
        name: (min(getattr(s, name) for s in samples), max(getattr(s, name) for s in samples))
        for name in ("handles", "threads", "tasks")
    }
