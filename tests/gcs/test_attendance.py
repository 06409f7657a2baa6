"""A follow that was confirmed in a browser ends when nobody is at the page any more (gcs.operator.attendance)."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import pytest

from control.engagement import State
from gcs.config import load
from gcs.errors import ConfigError
from gcs.operator.attendance import Absence, Attendance
from gcs.operator.orders import Abort, Confirm
from gcs.operator.terminal import NAME
from tests.gcs.web_rig import SOON_S, Browser, WebRig, web_rig


def looked(attendance: Attendance, *times_s: float, heard_s: float = -math.inf, **more: bool) -> list[Absence]:
    facts = {"engaged": True, "elsewhere": False, **more}
    return [attendance.look(now_s, heard_s, **facts) for now_s in times_s]


class TestAttendance:
    def test_warned_after_half_of_it_and_ended_after_all(self):
        attendance = Attendance(10.0)
        attendance.took(100.0)
        assert looked(attendance, 104.9, 105.0, 109.9, 110.0, 500.0) == [
            Absence.NONE, Absence.LONG, Absence.LONG, Absence.TOO_LONG, Absence.TOO_LONG,
        ]  # fmt: skip
        assert attendance.left_s(107.0) == 3.0

    def test_whoever_is_heard_is_somebody(self):
        attendance = Attendance(10.0)
        attendance.took(100.0)
        assert looked(attendance, 109.0, heard_s=104.0) == [Absence.LONG]
        assert looked(attendance, 109.1, heard_s=109.0) == [Absence.NONE]
        assert looked(attendance, 118.9, 119.0) == [Absence.LONG, Absence.TOO_LONG]

    def test_a_follow_of_others_is_theirs(self):
        assert looked(Attendance(10.0), 100.0, 200.0) == [Absence.NONE] * 2
        attendance = Attendance(10.0)
        attendance.took(100.0)
        assert looked(attendance, 106.0, elsewhere=True) == [Absence.NONE]
        assert looked(attendance, 200.0) == [Absence.NONE]
        attendance.took(200.0)  # back again
        assert looked(attendance, 211.0) == [Absence.TOO_LONG]

    def test_the_next_follow_is_another(self):
        attendance = Attendance(10.0)
        attendance.took(100.0)
        assert looked(attendance, 101.0, engaged=False) == [Absence.NONE]
        assert looked(attendance, 300.0) == [Absence.NONE]

    def test_never(self):
        attendance = Attendance(None)
        attendance.took(100.0)
        assert looked(attendance, 1e9) == [Absence.NONE]


@pytest.mark.parametrize(
    ("value", "fits"), [("2", True), ("120.0", True), ("null", True), ("1.9", False), ("0", False)]
)
def test_its_range(value, fits, tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(f"page:\n  abandoned_s: {value}\n")
    if fits:
        assert load(path).page.abandoned_s == (None if value == "null" else float(value))
    else:
        with pytest.raises(ConfigError, match="abandoned_s"):
            load(path)


async def follows(rig: WebRig) -> Browser:
    """A browser that has confirmed."""
    browser = await rig.browser()
    await browser.ask("candidate", number=1)
    await browser.ask("hold_begin")
    rig.clock.advance(1.0)
    assert (await browser.ask("confirm"))["ok"]
    return browser


async def soon(what) -> None:
    async with asyncio.timeout(SOON_S):
        while not what():
            await asyncio.sleep(0.01)


@pytest.fixture(autouse=True)
def look_often(monkeypatch):
    monkeypatch.setattr("gcs.operator.web.stage.LOOK_S", 0.01)


async def test_when_the_last_page_has_vanished_the_follow_is_aborted():
    async with web_rig() as rig:
        browser, other = await follows(rig), await rig.browser()
        await other.ask("ping")
        for each in (browser, other):
            each.ws._response.connection.transport.abort()  # as a phone that dies
        await soon(lambda: not len(rig.page._audience))
        rig.clock.advance(9.0)
        await soon(lambda: rig.acts[-1] == ("page", "nobody is at the page: the follow ends in 1 s"))
        assert isinstance(rig.station.orders[-1], Confirm)
        rig.clock.advance(1.1)
        await soon(lambda: rig.acts[-1] == ("page", "nobody is at the page any more: stopped and holding"))
        assert [type(order) for order in rig.station.orders].count(Abort) == 1
        late = await rig.browser()
        await soon_said(late, "nobody is at the page any more")


async def soon_said(browser: Browser, text: str) -> None:
    while not any(text in said for said in browser.said):
        await browser.hear("say")


async def test_a_page_that_is_silent_has_vanished_too():
    async with web_rig() as rig:
        await follows(rig)
        rig.clock.advance(10.1)  # its connection still stands, as when the Wi-Fi has gone
        await soon(lambda: isinstance(rig.station.orders[-1], Abort))


@pytest.mark.parametrize("why", ["another browser", "terminal", "confirmed there"])
async def test_somebody_is_there_still(why):
    async with web_rig() as rig:
        if why == "confirmed there":
            browser = await rig.browser()
            rig.station.base = replace(rig.station.base, state=State.FOLLOWING)
        else:
            browser = await follows(rig)
        other = await rig.browser()
        await browser.ws.close()
        for _ in range(5):
            if why == "terminal":
                rig.lease.take(NAME, rig.clock.now_s(), by_force=True)
            rig.clock.advance(4.0)
            if why == "another browser":
                await other.ask("ping")
            await asyncio.sleep(0.03)
        assert Abort() not in rig.station.orders
