"""All who look at the page: what is told once reaches each, and nobody waits for another."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, Protocol

from gcs.operator.web.report_types import SayReport, Starting

if TYPE_CHECKING:  # brings OpenCV, which a page that only starts up does not need
    from gcs.operator.web.pictures import Picture

_LINES_KEPT: Final = 20


class Looker(Protocol):
    """Somebody who looks, by a WebSocket or at the plain stream of pictures."""

    @property
    def name(self) -> str:
        """As which it may be in control; empty: as nobody."""
        ...

    @property
    def wants_picture(self) -> bool:
        """Another picture could be sent now."""
        ...

    @property
    def wants_candidates(self) -> bool: ...

    def show(self, picture: Picture) -> None:
        """Send this picture, unless a newer one comes before there is room."""
        ...

    def put(self, kind: str, data: bytes) -> None:
        """Send this text; it replaces what is not yet sent of its kind."""
        ...

    def add(self, data: bytes) -> None:
        """Send this text too, whatever else there is."""
        ...

    def forget(self) -> None:
        """The station has gone: numbers of frames begin anew."""
        ...

    async def close(self, code: int, reason: str) -> None:
        """It has to leave."""
        ...


class Audience:
    """Everything here is on the event loop and returns at once."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._lookers: list[Looker] = []
        self._lines: deque[bytes] = deque(maxlen=_LINES_KEPT)

    def __len__(self) -> int:
        return len(self._lookers)

    def __iter__(self) -> Iterator[Looker]:
        return iter(tuple(self._lookers))

    @property
    def is_full(self) -> bool:
        """Nobody else can be let in."""
        return len(self._lookers) >= self._most

    def enter(self, looker: Looker) -> None:
        """Tell it of everything from now on, and of what was said lately."""
        self._lookers.append(looker)
        for line in self._lines:
            looker.add(line)

    def leave(self, looker: Looker) -> None:
        """No more."""
        self._lookers.remove(looker)

    def wants_picture(self) -> bool:
        """Whether encoding one is worth it."""
        return any(looker.wants_picture for looker in self._lookers)

    def wants_candidates(self) -> bool:
        """Whether anybody asks for them."""
        return any(looker.wants_candidates for looker in self._lookers)

    def show(self, picture: Picture) -> None:
        """A new picture for all."""
        for looker in self._lookers:
            looker.show(picture)

    def put(self, kind: str, data: bytes) -> None:
        """A text for all, see `Looker.put`."""
        for looker in self._lookers:
            looker.put(kind, data)

    def put_each(self, kind: str, data: bytes, other: bytes, who: str) -> None:
        """`other` for who bears this name, `data` for everybody else."""
        for looker in self._lookers:
            looker.put(kind, other if looker.name == who else data)

    def put_candidates(self, data: bytes) -> None:
        """For those who ask for them."""
        for looker in self._lookers:
            if looker.wants_candidates:
                looker.put("candidates", data)

    def say(self, text: str, t_s: float, but: Looker | None = None) -> None:
        """A line for all (but one), and for who comes next."""
        line = SayReport(text=text, t_s=t_s).encode()
        self._lines.append(line)
        for looker in self._lookers:
            if looker is not but:
                looker.add(line)

    async def close(self, code: int, reason: str) -> None:
        """All have to leave."""
        async with asyncio.TaskGroup() as group:
            for looker in self._lookers:
                group.create_task(looker.close(code, reason))

    def starting(self, text: str) -> None:
        """There is no station (any more)."""
        line = Starting(text=text).encode()
        for looker in self._lookers:
            looker.forget()
            looker.put("station", line)
