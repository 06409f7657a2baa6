"""Hands each new value to those who wait for the next one."""

from __future__ import annotations

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class Next(Generic[T]):
    """On one event loop."""

    def __init__(self) -> None:
        self._waiting: set[asyncio.Future[T]] = set()

    async def get(self) -> T:
        """The next value that is told."""
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._waiting.add(future)
        return await future

    def tell(self, value: T) -> None:
        """To all that wait now."""
        waiting, self._waiting = self._waiting, set()
        for future in waiting:
            if not future.done():
                future.set_result(value)
