"""A place for one value between two stages: the newest wins, nothing queues up."""

from __future__ import annotations

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class SlotClosedError(Exception):
    """The producer has ended and its last value has been taken."""


class Slot(Generic[T]):
    """One producer, one consumer, one event loop; a value not taken in time is replaced and counted.

    A producer on another thread calls `loop.call_soon_threadsafe(slot.put, value)`.
    """

    def __init__(self) -> None:
        self._value: T | None = None
        self._full = asyncio.Event()
        self._closed = False
        self.replaced = 0  # values nobody took before the next one came

    def put(self, value: T) -> None:
        """Offer the newest value; after close() it is ignored."""
        if self._closed:
            return
        self.replaced += self._value is not None
        self._value = value
        self._full.set()

    def take(self) -> T | None:
        """The value waiting, or None; empties the slot."""
        value, self._value = self._value, None
        if not self._closed:
            self._full.clear()
        return value

    async def get(self) -> T:
        """Wait for a value and take it; SlotClosedError once closed and empty."""
        while True:
            await self._full.wait()
            value = self.take()
            if value is not None:
                return value
            if self._closed:
                raise SlotClosedError

    def close(self) -> None:
        """No more values: wakes the consumer."""
        self._closed = True
        self._full.set()
