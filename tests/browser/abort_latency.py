"""`python -m tests.browser.abort_latency [PRESSES]`: from Space in a real browser to zero at the vehicle's socket.

The station is a process of its own, follows a car that goes round in circles, and is aborted again and again. The key's
time is the browser's own, of the event it got; the setpoint's that of its datagram at the mock vehicle.
"""

from __future__ import annotations

import asyncio
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.async_api import async_playwright

from tests.browser.conftest import ARGS, LAPTOP, chromium, reads
from tests.browser.flight import Flown, draw_target, flown, hold_follow

LISTEN = """addEventListener('keydown', (event) => {
  if (event.code === 'Space') window.pressed = performance.timeOrigin + event.timeStamp;
}, true)"""
PATIENCE_S = 3.0


async def _once(flight: Flown, page: Any) -> float | None:
    """One flight and its abort; seconds to the first setpoint of zero, None where following did not begin or stay."""
    try:
        await draw_target(flight, page)
        await hold_follow(page)
    except Exception as error:  # noqa: BLE001 - Playwright's and pytest's; the next press may succeed
        print(f"not followed: {str(error).splitlines()[0]}", file=sys.stderr)
        return await _rest(page)
    await asyncio.sleep(0.7)
    before_s = time.monotonic()
    if not [still for at_s, still in flight.setpoints if at_s > before_s - 0.2 and not still]:
        await page.keyboard.press("Space")
        return await _rest(page)
    await page.keyboard.press("Space")
    offset_s = time.time() - time.monotonic()
    pressed_s = await page.evaluate("window.pressed") / 1000 - offset_s
    while (zero_s := flight.zero_after(pressed_s)) is None and time.monotonic() < pressed_s + PATIENCE_S:
        await asyncio.sleep(0.005)
    await _rest(page)
    return None if zero_s is None else zero_s - pressed_s


async def _rest(page: Any) -> None:
    """Ready for the next."""
    await asyncio.sleep(0.5)
    if await page.locator("#ack").is_visible():
        await page.click("#ack")
    await asyncio.sleep(0.3)


async def measure(presses: int) -> list[float]:
    """Seconds of each press that ended a follow."""
    found: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with async_playwright() as playwright, flown(folder) as flight:
            launched = await playwright.chromium.launch(executable_path=chromium(), args=list(ARGS))
            page = await (await launched.new_context(viewport=LAPTOP)).new_page()
            await page.add_init_script(LISTEN)
            await page.goto(flight.url)
            await page.locator("#state", has_text="IDLE").wait_for(timeout=60_000)
            await reads(page, "state", "IDLE")
            for _ in range(presses):
                taken_s = await _once(flight, page)
                if taken_s is not None:
                    found.append(taken_s)
            print(json.dumps({"unsafe": flight.monitor["unsafe"], "reasons": flight.monitor["reasons"][:3]}))
            await launched.close()
    return found


def main() -> None:
    """Print the median, the 99th percentile and the worst."""
    presses = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    found_ms = sorted(1000 * taken_s for taken_s in asyncio.run(measure(presses)))
    p99_ms = found_ms[min(len(found_ms) - 1, int(0.99 * len(found_ms)))]
    median_ms = statistics.median(found_ms)
    print(f"{len(found_ms)} aborts: median {median_ms:.0f} ms, p99 {p99_ms:.0f} ms, worst {found_ms[-1]:.0f} ms")


if __name__ == "__main__":
    main()
