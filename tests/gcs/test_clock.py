"""The two small parts everything waits on: the clock of tests, and a slot for the newest."""

from __future__ import annotations

import asyncio

import pytest

from gcs.clock import FakeClock
from gcs.slot import Slot, SlotClosedError


async def test_slot_keeps_only_the_newest():
    slot = Slot()
    slot.put(1)
    slot.put(2)
    assert await slot.get() == 2
    assert (slot.replaced, slot.take()) == (1, None)
    getting = asyncio.create_task(slot.get())
    await asyncio.sleep(0)
    assert not getting.done()
    slot.put(0)  # a false value is a value
    assert await getting == 0
    slot.put(3)
    slot.close()
    slot.put(4)
    assert await slot.get() == 3
    with pytest.raises(SlotClosedError):
        await slot.get()


def test_fake_clock_only_goes_forward():
    clock = FakeClock(5.0)
    assert clock.advance(0.5) == clock.now_s() == 5.5
    for bad in (-0.1, float("nan")):
        with pytest.raises(ValueError, match="cannot move"):
            clock.advance(bad)
