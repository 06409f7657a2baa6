"""What a run says while it works: one live line on a terminal, a plain line every half minute elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import tqdm

Say = Callable[[str], None]

LIVE_EVERY_S, PLAIN_EVERY_S, KEEP = 0.5, 30.0, 0.95


@dataclass
class Window:
    """What happened since the last line."""

    began_s: float
    samples: int = 0
    waited_s: float = 0.0

    def speed(self, now_s: float) -> float:
        """Samples per second."""
        return self.samples / max(now_s - self.began_s, 1e-6)

    def waiting(self, now_s: float) -> float:
        """Share of the time spent waiting for data."""
        return self.waited_s / max(now_s - self.began_s, 1e-6)


@dataclass
class Smoothed:
    """Running means of the losses, for the eye."""

    means: dict[str, float] = field(default_factory=dict)

    def add(self, parts: Mapping[str, float]) -> None:
        """One step's losses; those that are not numbers are left out."""
        for name, value in parts.items():
            if value == value:
                self.means[name] = KEEP * self.means.get(name, value) + (1 - KEEP) * value

    def text(self) -> str:
        """`name value` of each."""
        return "  ".join(f"{k} {v:.3f}" for k, v in self.means.items())


class Progress:
    """Says lines. live: rewrite one line at the bottom of the terminal between them; now_s: time.monotonic."""

    def __init__(self, say: Say, live: bool = False) -> None:
        self._say = say
        self._bar: Any = tqdm.tqdm(bar_format="{desc}", leave=False, dynamic_ncols=True) if live else None
        self._every_s = LIVE_EVERY_S if live else PLAIN_EVERY_S
        self.reset()

    def reset(self) -> None:
        """Forget speed and losses: another stage begins."""
        now = time.monotonic()
        self.window, self.losses, self._shown_s = Window(now), Smoothed(), now

    def note(self, parts: Mapping[str, float], samples: int, waited_s: float) -> None:
        """One step done."""
        self.losses.add(parts)
        self.window.samples += samples
        self.window.waited_s += waited_s

    def due(self, now_s: float) -> bool:
        """Whether it is time to show a line."""
        return now_s - self._shown_s > self._every_s

    def show(self, line: str, now_s: float) -> None:
        """The live line, or a plain one."""
        self._shown_s = now_s
        if now_s - self.window.began_s > PLAIN_EVERY_S:
            self.window = Window(now_s)
        if self._bar is None:
            self._say(line)
        else:
            self._bar.set_description_str(line)

    def say(self, line: str) -> None:
        """A line that stays."""
        if self._bar is not None:
            self._bar.clear()
        self._say(line)
        if self._bar is not None:
            self._bar.refresh()

    def close(self) -> None:
        """Take the live line away."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def minutes_text(seconds: float) -> str:
    """As a person says it: 40 s, 12 min, 3.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 2 * 3600 else f"{seconds / 3600:.1f} h"
