"""What a browser may order, and who is in control (gcs.operator.web over a real socket)."""

from __future__ import annotations

import asyncio
import json

import pytest

from control.modes import FollowMode
from gcs.errors import GcsError
from gcs.operator import orders
from gcs.operator.lease import LEASE_S
from tests.gcs.web_rig import Browser, web_rig
from tracker.box import Box


def done(rig) -> list[str]:
    return [type(order).__name__ for order in rig.station.orders]


async def select(rig, browser: Browser) -> dict:
    return await browser.ask("select", box=[10, 20, 30, 40], frame=rig.station.frames.newest.seq)


async def held(rig, browser: Browser, held_s: float = 1.0) -> dict:
    assert (await browser.ask("hold_begin"))["ok"]
    rig.clock.advance(held_s)
    return await browser.ask("confirm")


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


class TestConfirm:
    async def test_held_for_a_second_it_follows(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            answer = await held(rig, browser)
            assert (answer["ok"], answer["text"]) == (True, "follow confirmed at 15.0 m")
            assert done(rig) == ["Select", "Confirm"]

    async def test_without_holding_or_too_short_it_does_not(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            assert not (await browser.ask("confirm"))["ok"]
            assert "0.5 s only" in (await held(rig, browser, 0.5))["text"]
            assert done(rig) == ["Select"]

    async def test_let_go_and_held_no_more(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            await browser.ask("hold_begin")
            await browser.ask("hold_end")
            rig.clock.advance(1.0)
            assert not (await browser.ask("confirm"))["ok"]
            assert done(rig) == ["Select"]

    async def test_not_for_what_is_selected_meanwhile(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            await browser.ask("hold_begin")
            await select(rig, browser)
            rig.clock.advance(1.0)
            assert "another target" in (await browser.ask("confirm"))["text"]
            assert done(rig) == ["Select", "Select"]

    async def test_not_by_another_connection_of_the_same_browser(self):
        async with web_rig() as rig:
            session = await rig.session()
            first = await rig.browser(session)
            await select(rig, first)
            await first.ask("hold_begin")
            await first.ws.close()
            rig.clock.advance(1.0)
            again = await rig.browser(session)
            assert not (await again.ask("confirm"))["ok"]
            assert done(rig) == ["Select"]

    async def test_not_by_who_lost_control_while_holding(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await select(rig, one)
            await one.ask("hold_begin")
            assert (await two.ask("take", force=True))["ok"]
            rig.clock.advance(1.0)
            assert (await one.ask("confirm"))["text"] == "page 2 is in control"
            assert not (await two.ask("confirm"))["ok"]  # it is its own button that has to be held
            assert done(rig) == ["Select"]

    async def test_not_by_who_took_control_back_while_holding(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await select(rig, one)
            await one.ask("hold_begin")
            await two.ask("take", force=True)
            await one.ask("take", force=True)
            rig.clock.advance(1.0)
            assert not (await one.ask("confirm"))["ok"]
            assert done(rig) == ["Select"]

    async def test_not_after_the_lease_ran_out(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            rig.clock.advance(LEASE_S - 0.5)
            assert (await browser.ask("hold_begin"))["ok"]
            rig.lease.release("page 1")
            rig.clock.advance(1.0)
            assert "control has been lost" in (await browser.ask("confirm"))["text"]
            assert done(rig) == ["Select"]

    async def test_every_reason_of_a_refusal_is_told(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await select(rig, browser)
            rig.station.refused = ("not armed", "no position")
            answer = await held(rig, browser)
            assert not answer["ok"]
            assert answer["reasons"] == ["not armed", "no position"]


class TestControl:
    async def test_the_first_that_orders_is_in_control_and_only_one(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await select(rig, one)
            for do, more in (("land", {}), ("hold_begin", {}), ("take", {}), ("deselect", {}), ("takeoff", {})):
                answer = await two.ask(do, **more)
                assert (answer["ok"], answer["text"]) == (False, "page 1 is in control"), do
            assert done(rig) == ["Select"]
            assert (await one.hear("status"))["in_control"]
            status = await two.hear("status")
            assert (status["controller"], status["in_control"], status["viewers"]) == ("page 1", False, 2)

    async def test_who_is_not_heard_loses_it(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await one.ask("take")
            rig.clock.advance(LEASE_S - 1)
            await one.ask("ping")
            rig.clock.advance(LEASE_S - 1)
            assert not (await two.ask("take"))["ok"]
            rig.clock.advance(1.1)
            assert (await two.ask("take"))["ok"]
            await one.ask("ping")  # brings nothing back
            assert rig.lease.holder(rig.clock.now_s()) == "page 2"

    async def test_a_ping_takes_no_control(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.ask("ping")
            assert rig.lease.holder(rig.clock.now_s()) == ""

    async def test_taken_by_force_and_given_back(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await one.ask("take")
            assert (await two.ask("take", force=True))["ok"]
            assert not (await one.ask("land"))["ok"]
            assert "page 2: in control instead of page 1" in one.said
            await one.ask("release")  # not his to give
            assert rig.lease.holder(rig.clock.now_s()) == "page 2"
            await two.ask("release")
            assert (await one.ask("land"))["ok"]

    async def test_others_than_pages_hold_it_too(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            rig.lease.take("terminal", rig.clock.now_s())
            assert (await browser.ask("land"))["text"] == "terminal is in control"

    async def test_who_has_left_leaves_it_free(self):
        async with web_rig() as rig:
            one = await rig.browser()
            await one.ask("take")
            two = await rig.browser()
            assert not (await two.ask("land"))["ok"]
            await one.ws.close()
            while (await two.hear("status"))["controller"]:
                pass
            assert (await two.ask("land"))["ok"]

    async def test_abort_is_everybodys(self):
        async with web_rig() as rig:
            one, two = await rig.browser(), await rig.browser()
            await select(rig, one)
            await held(rig, one)
            assert (await two.ask("abort"))["ok"]
            await two.ws.send_str('{"do":"abort"}')  # whoever wants no answer
            await two.ask("ping")
            assert done(rig) == ["Select", "Confirm", "Abort", "Abort"]
            assert rig.lease.holder(rig.clock.now_s()) == "page 1"

    async def test_coming_back_shows_what_is_and_arms_nothing(self):
        async with web_rig() as rig:
            session = await rig.session()
            first = await rig.browser(session)
            await select(rig, first)
            await held(rig, first)
            await first.ws.close()
            again = await rig.browser(session)
            assert (await again.hear("welcome"))["viewer"] == "page 2"
            status = await again.hear("status")
            assert (status["state"], status["in_control"], status["controller"]) == ("following", False, "")
            assert done(rig) == ["Select", "Confirm"]

    async def test_a_station_that_refuses_an_abort_says_so(self):
        async with web_rig() as rig:

            async def refuse(order):
                raise GcsError("nothing flies")

            rig.station.perform = refuse
            session = await rig.session()
            async with session.post("/abort", headers={"Origin": rig.base}) as response:
                assert response.status == 409
                assert await response.json() == {"ok": False, "text": "nothing flies"}
