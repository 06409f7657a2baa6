"""What pages are shown (gcs.operator.web)."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import aiohttp
import cv2
import numpy as np
import pytest

from control.engagement import State
from tests.gcs.web_rig import TOKEN, web_rig
from tracker.box import Box


class TestShown:
    async def test_waiting_then_the_station_then_waiting_again(self):
        async with web_rig(attached=False) as rig:
            rig.page.starting("loading the tracker")
            browser = await rig.browser()
            assert (await browser.hear("starting"))["text"] == "loading the tracker"
            assert (await browser.ask("takeoff"))["text"] == "not yet: loading the tracker"
            assert (await browser.ask("ping"))["ok"]
            rig.page.starting("waiting for the vehicle")
            assert (await browser.hear("starting"))["text"] == "waiting for the vehicle"
            rig.page.attach(rig.station)
            welcome = await browser.hear("welcome")
            assert (welcome["viewer"], welcome["size"], welcome["watermark"]) == ("page 1", [320, 240], "SIM")
            await browser.hear("status")
            rig.page.starting("the flight has ended")
            rig.page.detach()
            assert (await browser.hear("starting"))["text"] == "the flight has ended"
            assert not (await browser.ask("land"))["ok"]

    async def test_who_waits_is_reminded_that_somebody_is_there(self, monkeypatch):
        monkeypatch.setattr("gcs.operator.web.server._REMIND_S", 0.01)
        async with web_rig(attached=False) as rig:
            browser = await rig.browser()
            for _ in range(3):
                await browser.hear("starting")

    async def test_each_frame_by_its_number(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.hear("welcome")
            rig.station.show()
            frame = await browser.hear("frame")
            assert (frame["frame"], frame["box"], frame["selection"]) == (2, None, 0)
            await browser.ask("point", x=100, y=100, frame=2)
            sighting = rig.station.show()
            frame = await browser.hear("frame")
            assert frame["box"] == pytest.approx(sighting.seen.result.box.xywh, abs=0.06)
            assert frame["predicted"] == pytest.approx(sighting.predicted.xywh, abs=0.06)
            assert (frame["visible"], frame["confidence"], frame["selection"]) == (True, 0.87, 1)

    async def test_what_is_not_finite_or_numpys_own_is_still_json(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.ask("point", x=100, y=100, frame=1)
            vehicle = replace(rig.station.base.vehicle, height_m=math.nan, battery_frac=np.float32(0.5))
            rig.station.base = replace(
                rig.station.base, vehicle=vehicle, distance_m=math.inf, confidence=np.float64(0.25)
            )
            rig.station._target = lambda: Box(np.float64(math.nan), np.float32(2), 3, 4)
            rig.station.visible = False
            rig.station.show()
            assert (await browser.hear("frame"))["box"] == [None, 0.0, 3.0, 4.0]
            status = await browser.hear("status")
            while status["confidence"] != 0.25:
                status = await browser.hear("status")
            assert (status["distance_m"], status["vehicle"]["height_m"], status["vehicle"]["battery_frac"]) == (
                None,
                None,
                0.5,
            )

    async def test_a_change_of_state_is_told_at_once(self):
        """By the next frame, not by the next of the five a second."""
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.hear("map")  # the last of what is told to who has come
            rig.station.base = replace(rig.station.base, state=State.LOST_HOLD, reasons=("the target is lost",))
            rig.station.show()
            await browser.hear("frame")
            status = browser.heard["status"] if browser.heard["status"]["reasons"] else await browser.hear("status")
            assert status["headline"] == "LOST, HOLDING: the target is lost"
            assert status["tone"] == "caution"

    async def test_refusals_are_listed_while_something_is_selected(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            rig.station.refused = ("not armed", "no position")
            assert (await browser.hear("status"))["refusals"] == []
            await browser.ask("point", x=100, y=100, frame=1)
            assert (await browser.hear("status"))["refusals"] == ["not armed", "no position"]

    async def test_the_map_and_candidates_for_who_asks(self):
        async with web_rig() as rig:
            browser, other = await rig.browser(), await rig.browser()
            assert (await browser.hear("map"))["fence"]["radius_m"] == 60.0
            await browser.ask("candidates", on=True)
            found = (await browser.hear("candidates"))["boxes"]
            assert [each["number"] for each in found] == [1, 2]
            assert found[1]["box"] == [80.0, 85.0, 40.0, 30.0]
            await other.ask("ping")
            assert "candidates" not in other.heard

    async def test_what_was_said_lately_is_said_to_who_comes_late(self):
        async with web_rig() as rig:
            for number in range(30):
                rig.page.say(f"line {number}")
            browser = await rig.browser()
            await browser.ask("ping")
            assert browser.said == [f"line {number}" for number in range(10, 30)]

    async def test_a_fault_of_the_display_ends_no_flight_and_is_logged_once(self, caplog):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.ask("ping")
            for _ in range(3):
                rig.page._stage.feed.saw(None)  # a fault of its own: what it looks for is not there
            assert [record.message for record in caplog.records] == ["the page could not be told"]
            rig.station.show()
            await browser.hear("frame")


class TestPictures:
    async def test_a_picture_with_its_number_and_full_size(self):
        async with web_rig(size=(640, 480), most_width_px=320) as rig:
            browser = await rig.browser()
            message = await browser.picture()
            assert struct.unpack("<4I", message[:16]) == (1, 640, 480, 0)
            image = cv2.imdecode(np.frombuffer(message[16:], np.uint8), cv2.IMREAD_COLOR)
            assert image.shape == (240, 320, 3)
            assert abs(int(image[-1, 0, 1]) - 130) < 12

    async def test_two_on_their_way_and_no_more_until_one_is_seen(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            assert (await browser.picture())[:4] == struct.pack("<I", 1)
            rig.station.show()
            assert (await browser.picture())[:4] == struct.pack("<I", 2)
            for _ in range(3):
                rig.station.show()
                await browser.ask("ping")
            assert len(browser.pictures) == 2
            await browser.ws.send_str('{"do":"seen","frame":1}')
            await browser.ask("ping")
            rig.station.show()
            assert (await browser.picture())[:4] == struct.pack("<I", 6)

    async def test_none_for_who_does_not_want_them_and_none_are_encoded_then(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.picture()
            await browser.ask("pictures", on=False)
            offered = []
            rig.page._stage.feed._pictures.offer = offered.append
            rig.station.show()
            await browser.ask("ping")
            assert offered == []
            await browser.ask("pictures", on=True)
            rig.station.show()
            assert [frame.seq for frame in offered] == [3]

    async def test_without_anybody_nothing_is_encoded_nor_told(self, caplog):
        async with web_rig() as rig:
            offered = []
            rig.page._stage.feed._pictures.offer = offered.append
            rig.station.show()
            rig.page._stage.feed.saw(None)  # would be a fault if it were looked at
            assert (offered, caplog.records) == ([], [])

    async def test_one_picture_alone_and_as_a_stream(self):
        async with web_rig() as rig:
            session = await rig.session(known=False)
            async with session.get(f"/snapshot.jpg?token={TOKEN}") as response:
                assert response.content_type == "image/jpeg"
                assert cv2.imdecode(np.frombuffer(await response.read(), np.uint8), 1).shape == (240, 320, 3)
            async with session.get(f"/video.mjpg?token={TOKEN}") as response:
                assert response.content_type == "multipart/x-mixed-replace"
                reader = aiohttp.MultipartReader.from_response(response)
                part = await reader.next()
                assert cv2.imdecode(np.frombuffer(await part.read(), np.uint8), 1).shape == (240, 320, 3)
                rig.station.show()
                assert (await (await reader.next()).read())[:2] == b"\xff\xd8"

    async def test_the_next_stations_pictures_may_count_from_the_start(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.picture()
            rig.page.detach()
            rig.page.attach(rig.station)
            assert (await browser.picture())[:4] == struct.pack("<I", 1)
