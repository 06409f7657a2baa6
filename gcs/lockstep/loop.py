"""An event loop whose time jumps: when nothing is ready it goes straight to the next timer.

Real tasks, timers and time-outs run on it unchanged and in no real time, in the same order on every run.
"""

from __future__ import annotations

import asyncio
import contextlib
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

_T = TypeVar("_T")


class _Jumping(selectors.SelectSelector):
    """Waits for nothing: the wait itself becomes the new time."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None:
            raise RuntimeError("every task waits and no timer is set: nothing would ever happen")
        self.now_s += max(timeout, 0.0)
        return []


class LockstepLoop(asyncio.SelectorEventLoop):
    """Also a `gcs.clock.Clock`. Work for other threads is done at once, on the loop."""

    def __init__(self, start_s: float = 100.0) -> None:
        self._jumping = _Jumping()
        self._jumping.now_s = start_s
        super().__init__(self._jumping)

    def time(self) -> float:
        """The fake time in s."""
        return self._jumping.now_s

    now_s = time

    def stall(self, to_s: float) -> None:
        """Time passes while a callback holds the loop; what was due meanwhile comes late."""
        self._jumping.now_s = max(self._jumping.now_s, to_s)

    def run_in_executor(self, executor: Any, func: Callable[..., _T], *args: Any) -> asyncio.Future[_T]:  # type: ignore[override]
        """Deterministic: no thread."""
        future: asyncio.Future[_T] = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - as the executor would, it goes to whoever awaits
            future.set_exception(error)
        return future


def run(main: Callable[[LockstepLoop], Coroutine[Any, Any, _T]]) -> _T:
    """Run `main(loop)` to its end on a fresh loop, then cancel what is left."""
    loop = LockstepLoop()
    try:
        asyncio.set_event_loop(loop)
        return loop.run_until_complete(main(loop))
    finally:
        left = asyncio.all_tasks(loop)
        for task in left:
            task.cancel()
        with contextlib.suppress(BaseException):
            loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        asyncio.set_event_loop(None)
        loop.close()
