"""A thread for one piece of work that takes long: asyncio's default ones are few, and other packages wait for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


async def on_own_thread(work: Callable[[], T]) -> T:
    """Its result, or what it raised; whoever stops waiting leaves it to itself."""
    own = ThreadPoolExecutor(1, thread_name_prefix="video out")
    try:
        return await asyncio.get_running_loop().run_in_executor(own, work)
    finally:
        own.shutdown(wait=False)
