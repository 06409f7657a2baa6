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

    async def perform(self, order: Order) -> str:
        if isinstance(order, Quit):
            raise SystemExit
        return await super().perform(order)


async def main() -> None:
    station = Leaving()
    operator = TerminalOperator(station, Screen(sys.stdout), lease=Lease(), plain="--plain" in sys.argv)
    async with asyncio.TaskGroup() as group:
        group.create_task(station.run())
        group.create_task(operator.run())


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt, SystemExit, BaseExceptionGroup):
        asyncio.run(main())
