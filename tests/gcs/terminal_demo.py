"""The terminal's display with a station without a flight: `python -m tests.gcs.terminal_demo [--plain]`."""

from __future__ import annotations

import asyncio
import contextlib
import sys

from gcs.operator.lease import Lease
from gcs.operator.orders import Order, Quit
from gcs.operator.terminal import Screen, TerminalOperator
from tests.gcs.fake_station import FakeStation


class Leaving(FakeStation):
    """Ends with the order to quit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.left = asyncio.Event()

    async def perform(self, order: Order) -> str:
        if isinstance(order, Quit):
            self.left.set()
            return "leaving"
        return await super().perform(order)


async def main() -> None:
    station = Leaving()
    screen = Screen(sys.stdout)
    operator = TerminalOperator(station, screen, lease=Lease(), plain="--plain" in sys.argv)
    running = [asyncio.create_task(station.run()), asyncio.create_task(operator.run())]
    await station.left.wait()
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    screen.end()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(main())
