"""Where what was recorded and what came out again differ: the field, both values, and by how much at most."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from gcs.recorder.message_log import encoder

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Floats may differ by absolute + relative * the recorded one; all else must be equal."""

    absolute: float = 0.0
    relative: float = 0.0

    def allows(self, recorded: float, again: float) -> bool:
        """Whether it is near enough; two that are the same always are."""
        return recorded == again or abs(again - recorded) <= self.absolute + self.relative * abs(recorded)


EXACT = Tolerance()


@dataclass(frozen=True, slots=True)
class Difference:
    """frame: its number, or the time of a tick. path: of the field, as `result.box.cx_px`."""

    what: str
    frame: int | None
    t_s: float
    path: str
    recorded: Any
    again: Any

    def __str__(self) -> str:
        where = f"frame {self.frame}" if self.frame is not None else f"{self.what} at {self.t_s:.3f} s"
        return f"{where}, {self.path}: recorded {_short(self.recorded)}, again {_short(self.again)}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


@dataclass(slots=True)
class Comparison:
    """Give it both sides of each event. furthest: by field, the largest distance of floats that are not the same."""

    tolerance: Tolerance = EXACT
    compared: dict[str, int] = field(default_factory=dict)
    differing: dict[str, int] = field(default_factory=dict)  # events with a difference beyond the tolerance
    first: Difference | None = None
    furthest: dict[str, float] = field(default_factory=dict)

    def event(self, what: str, frame: int | None, t_s: float, recorded: msgspec.Raw, again: object) -> None:
        """recorded: its JSON in the log. again: the dataclass that would be written now."""
        self.compared[what] = self.compared.get(what, 0) + 1
        made = encoder().encode(again)
        if made == bytes(recorded):
            return
        differs = False
        for path, old, new in differences(msgspec.json.decode(recorded), msgspec.json.decode(made)):
            name = ".".join(path)
            if _are_floats(old, new):
                self.furthest[name] = max(self.furthest.get(name, 0.0), abs(new - old))
                if self.tolerance.allows(old, new):
                    continue
            differs = True
            if self.first is None:
                self.first = Difference(what, frame, t_s, name, old, new)
        if differs:
            self.differing[what] = self.differing.get(what, 0) + 1

    @property
    def is_equal(self) -> bool:
        """Everything is as it was, within the tolerance."""
        return not self.differing

    @property
    def is_exact(self) -> bool:
        """To the last bit."""
        return self.is_equal and not self.furthest


def _are_floats(old: Any, new: Any) -> bool:
    plain = all(isinstance(each, int | float) and not isinstance(each, bool) for each in (old, new))
    return plain and (isinstance(old, float) or isinstance(new, float)) and math.isfinite(old) and math.isfinite(new)


def differences(recorded: Any, again: Any, path: Path = ()) -> Iterator[tuple[Path, Any, Any]]:
    """(path, recorded, again) of every value that is not the same."""
    if isinstance(recorded, dict) and isinstance(again, dict):
        for key in {**recorded, **again}:
            yield from differences(recorded.get(key), again.get(key), (*path, key))
    elif isinstance(recorded, list) and isinstance(again, list) and len(recorded) == len(again):
        for index, (old, new) in enumerate(zip(recorded, again, strict=True)):
            yield from differences(old, new, (*path, str(index)))
    elif recorded != again or isinstance(recorded, bool) is not isinstance(again, bool):  # 240 is 240.0, True is not 1
        yield path, recorded, again
