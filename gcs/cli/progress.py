"""How far a command is, where it takes longer than two seconds and somebody looks on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, TypeVar

from tqdm import tqdm

Thing = TypeVar("Thing")

_SAID_S: Final = 2.0


def shown_progress(things: Iterable[Thing], what: str, unit: str, total: int | None = None) -> Iterator[Thing]:
    """The same things, with a bar on a terminal's stderr while they are gone through."""
    yield from tqdm(things, desc=what, total=total, unit=f" {unit}", delay=_SAID_S, leave=False, disable=None)
