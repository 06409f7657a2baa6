"""python -m tests.page_load [--fake [--port 8870] [--size 640x480]]: measure the page, or only serve it."""

from __future__ import annotations

import argparse
import asyncio

from gcs.clock import MonotonicClock
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.server import Page
from gcs.operator.web.static_files import read_all
from tests.gcs.fake_station import FakeStation
from tests.page_load.measure import measure


async def serve(port: int, size: tuple[int, int], token: str | None) -> None:
    """A page with moving pictures and scripted states, until interrupted; its files are read again as they change."""
    page = Page(PageConfig(port=port, token=token), MonotonicClock(), lease=Lease())
    await page.open()
    print(page.url, flush=True)
    station = FakeStation(size)
    page.attach(station)
    async with asyncio.TaskGroup() as group:
        group.create_task(station.run(20.0))
        while True:
            await asyncio.sleep(0.5)
            page.files = read_all()


def size_of(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT in px."""
    width_px, height_px = map(int, text.split("x"))
    return width_px, height_px


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.page_load", description=__doc__)
    parser.add_argument("--fake", action="store_true", help="only serve the page")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--size", type=size_of, action="append")
    parser.add_argument("--token")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each turn")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    sizes = args.size or [(640, 480), (1280, 720)]
    try:
        if args.fake:
            asyncio.run(serve(args.port, sizes[0], args.token))
        for size in sizes:
            asyncio.run(measure(size, args.seconds, args.rounds))
    except KeyboardInterrupt:
        return


if __name__ == "__main__":
    main()
