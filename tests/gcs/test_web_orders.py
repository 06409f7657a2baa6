"""What a browser may order (gcs.operator.web over a real socket)."""

from __future__ import annotations

import asyncio
import json

import pytest

from control.modes import FollowMode
from gcs.operator import orders
from tests.gcs.web_rig import select, web_rig
from tracker.box import Box


class TestOrders:
    async def test_a_box_is_of_the_picture_it_was_drawn_on(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            drawn_on = rig.station.frames.newest
            rig.station.show()
            assert (await browser.ask("select", box=[10, 20, 30, 40], frame=drawn_on.seq))["text"] == "selected"
            order = rig.station.orders[0]
            assert order == orders.Select(Box(25, 40, 30, 40), drawn_on)
            assert order.frame is drawn_on

    async def test_a_picture_that_is_gone_is_refused(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            for do, more in (("select", {"box": [1, 2, 30, 40]}), ("point", {"x": 3, "y": 4})):
                answer = await browser.ask(do, frame=77, **more)
                assert (answer["ok"], answer["text"]) == (False, "that picture is too old: draw again")
            assert rig.station.orders == []

    @pytest.mark.parametrize(
        ("do", "more", "order"),
        [
            ("candidate", {"number": 2}, orders.SelectCandidate(2)),
            ("deselect", {}, orders.Deselect()),
            ("ack", {}, orders.Acknowledge()),
            ("mode", {"mode": "orbit"}, orders.SetMode(FollowMode.ORBIT)),
            ("standoff", {"m": 12.5}, orders.SetStandoff(12.5)),
            ("standoff", {"m": None}, orders.SetStandoff(None)),
            ("step", {"m": -2}, orders.StepStandoff(-2.0)),
            ("distance", {"m": 30}, orders.SetDistance(30.0)),
            ("distance", {}, orders.SetDistance(None)),
            ("hold", {}, orders.Hold()),
            ("takeoff", {"height_m": 8}, orders.TakeOff(8.0)),
            ("takeoff", {}, orders.TakeOff(None)),
            ("land", {}, orders.Land()),
            ("return", {}, orders.Return()),
            ("record", {"on": True}, orders.Record(True)),
            ("record", {}, orders.Record(None)),
            ("accept", {"name": " com_of_loss_t "}, orders.Accept("COM_OF_LOSS_T")),
        ],
    )
    async def test_each_is_what_it_says(self, do, more, order):
        async with web_rig() as rig:
            browser = await rig.browser()
            assert (await browser.ask(do, **more))["ok"]
            assert rig.station.orders == [order]

    @pytest.mark.parametrize(
        ("do", "more", "why"),
        [
            ("mode", {"mode": "chase"}, "no mode 'chase'"),
            ("standoff", {"m": 0}, "must be more than 0"),
            ("distance", {"m": -3}, "must be more than 0"),
            ("takeoff", {"height_m": -1}, "must be more than 0"),
            ("select", {"box": [1, 2, 0, 40], "frame": 1}, "the box is empty"),
        ],
    )
    async def test_a_value_that_makes_no_sense_is_refused_and_the_page_stays(self, do, more, why):
        async with web_rig() as rig:
            browser = await rig.browser()
            answer = await browser.ask(do, **more)
            assert not answer["ok"]
            assert why in answer["text"]
            assert rig.station.orders == []
            assert (await browser.ask("ping"))["ok"]

    async def test_a_long_order_keeps_nobody_waiting(self):
        async with web_rig() as rig:
            climbing, reached = asyncio.Event(), asyncio.Event()
            perform = rig.station.perform

            async def slow(order):
                if isinstance(order, orders.TakeOff):
                    climbing.set()
                    await reached.wait()
                return await perform(order)

            rig.station.perform = slow
            browser = await rig.browser()
            await browser.ws.send_str(json.dumps({"id": 900, "do": "takeoff"}))
            await climbing.wait()
            assert (await browser.ask("abort"))["text"] == "abort: zero, then hold"
            assert (await browser.ask("ping"))["ok"]
            reached.set()
            assert (await browser.hear("answer"))["id"] == 900

    async def test_more_than_eight_at_once_are_too_much_but_an_abort_never_is(self):
        async with web_rig() as rig:
            never = asyncio.Event()
            perform = rig.station.perform

            async def stuck(order):
                return await perform(order) if isinstance(order, orders.Abort) else await never.wait()

            rig.station.perform = stuck
            browser = await rig.browser()
            for number in range(8):
                await browser.ws.send_str(json.dumps({"id": 900 + number, "do": "land"}))
            assert "too much at once" in (await browser.ask("land"))["text"]
            assert (await browser.ask("abort"))["ok"]

    async def test_a_fault_in_an_order_is_answered_and_ends_nothing(self):
        async with web_rig() as rig:
            browser = await rig.browser()

            async def broken(order):
                raise KeyError("x")

            rig.station.perform = broken
            assert (await browser.ask("land"))["text"] == "a fault of this program: KeyError"
            assert not (await browser.ask("abort"))["ok"]
            assert (await browser.ask("ping"))["ok"]

    async def test_the_others_are_told_who_did_what(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await select(rig, one)
            assert (await two.hear("say"))["text"] == "page 1: in control"
            assert (await two.hear("say"))["text"] == "page 1: selected"
            await one.ask("ping")
            assert one.said == []
            assert rig.acts == [("page 1", "in control"), ("page 1", "selected")]
