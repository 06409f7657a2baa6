"""Browsers without a window, in a process of their own: they take every picture and say that they have seen it."""

from __future__ import annotations

import argparse
import asyncio
import json
import struct
import sys
import time

import aiohttp

from gcs.operator.web.report_types import PICTURE_HEAD_BYTES


async def session_of(url: str) -> aiohttp.ClientSession:
    """With the cookie for this link; the page has been loaded."""
    session = aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True))
    async with session.get(url) as response:
        response.raise_for_status()
        await response.read()
    return session


async def look(url: str, seconds: float, pictures: bool = True) -> dict[str, float]:
    """Pictures and texts that came, bytes, and how long the first picture took (s)."""
    started_s = time.perf_counter()
    base = url.partition("/?")[0]
    found = {"pictures": 0, "texts": 0, "bytes": 0, "first_s": 0.0}
    async with await session_of(url) as session, session.ws_connect(f"{base}/ws", origin=base, max_msg_size=0) as ws:
        if not pictures:
            await ws.send_str(json.dumps({"do": "pictures", "on": False}))
        while time.perf_counter() - started_s < seconds:
            message = await ws.receive()
            if message.type is aiohttp.WSMsgType.BINARY:
                found["first_s"] = found["first_s"] or time.perf_counter() - started_s
                found["pictures"] += 1
                found["bytes"] += len(message.data) - PICTURE_HEAD_BYTES
                await ws.send_str(f'{{"do":"seen","frame":{struct.unpack_from("<I", message.data)[0]}}}')
            elif message.type is aiohttp.WSMsgType.TEXT:
                found["texts"] += 1
            else:
                raise ConnectionError(f"closed: {ws.close_code} {message.extra}")
    return found


async def many(url: str, count: int, seconds: float, pictures: bool) -> dict[str, float]:
    """All of them together: the mean of each."""
    each = await asyncio.gather(*(look(url, seconds, pictures) for _ in range(count)))
    return {name: sum(one[name] for one in each) / count for name in each[0]}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.page_load.viewers")
    parser.add_argument("url")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--no-pictures", action="store_true")
    args = parser.parse_args()
    json.dump(asyncio.run(many(args.url, args.count, args.seconds, not args.no_pictures)), sys.stdout)


if __name__ == "__main__":
    main()
