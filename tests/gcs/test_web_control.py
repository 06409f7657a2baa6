"""Confirming a follow from a browser, and who is in control (gcs.operator.web over a real socket)."""

from __future__ import annotations

from gcs.errors import GcsError
from gcs.operator.lease import LEASE_S
from tests.gcs.web_rig import done, held, select, web_rig


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
