"""For what another thread does soon."""

from __future__ import annotations

import time
from collections.abc import Callable


def wait_for(true: Callable[[], bool]) -> None:
    """Until it is so; fails after 10 s."""
    deadline_s = time.monotonic() + 10.0
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
