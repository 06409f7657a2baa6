"""WebRTC against aiortc's own receiver: the right picture with the right number, bounded, nothing left behind."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import pytest_asyncio
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from gcs.errors import GcsError
from gcs.operator.web import webrtc
from gcs.video_out import peer, peers
from gcs.video_out.encoder import Coded
from gcs.video_out.live import LiveStream
from gcs.video_out.peers import Peers
from tests.gcs.numbered import NumberedStation, number_of
from tests.gcs.web_rig import web_rig

HIDDEN = "a=candidate:1 1 udp 2113937151 5e1f2b0c-0000-4000-8000-000000000000.local 50000 typ host\r\n"


class Refusing(ThreadPoolExecutor):
    """In place of asyncio's default threads: nothing of ours may be given to them."""

    def submit(self, *args: Any, **kwargs: Any) -> Any:
        raise AssertionError("the default executor was used")


class Receiver:
    """A browser, nearly."""

    def __init__(self) -> None:
        self.connection: Any = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.times: dict[int, int] = {}  # as told: of each frame number
        self.track: Any = None
        self.connection.addTransceiver("video", direction="recvonly")
        channel = self.connection.createDataChannel("frames", ordered=False, maxRetransmits=0)
        channel.on("message", self._told)
        self.connection.on("track", self._came)

    def _told(self, text: str) -> None:
        self.times.update((number, time) for time, number in json.loads(text))

    def _came(self, track: Any) -> None:
        self.track = track

    async def offer(self) -> str:
        await self.connection.setLocalDescription(await self.connection.createOffer())
        return str(self.connection.localDescription.sdp)

    async def connect(self, peers: Peers) -> None:
        answer = await peers.answer((await self.offer()) + HIDDEN)
        await self.connection.setRemoteDescription(RTCSessionDescription(answer, "answer"))

    async def pictures(self, count: int) -> list[tuple[int, int]]:
        """(number in the picture, its RTP time since the first)."""
        found = []
        for _ in range(count):
            frame = await asyncio.wait_for(self.track.recv(), 10)
            found.append((number_of(frame.to_ndarray(format="bgr24")), frame.pts))
        return found


@pytest_asyncio.fixture
async def station() -> AsyncIterator[NumberedStation]:
    station = NumberedStation((640, 480))
    running = asyncio.create_task(station.run(50.0))
    yield station
    running.cancel()


@pytest_asyncio.fixture
async def serving(station: NumberedStation) -> AsyncIterator[Peers]:
    asyncio.get_running_loop().set_default_executor(Refusing(1))
    serving = Peers(station)
    yield serving
    await serving.close_all()


async def soon(is_so: Callable[[], object]) -> None:
    async with asyncio.timeout(10):
        while not is_so():
            await asyncio.sleep(0.005)


async def test_each_picture_is_the_frame_that_is_told_for_its_time_and_all_share_one_encoder(serving, station):
    receivers = [Receiver(), Receiver()]
    for receiver in receivers:
        await receiver.connect(serving)
    found = await asyncio.gather(*(receiver.pictures(20) for receiver in receivers))
    assert (serving.count, len(station.watchers)) == (2, 1)
    for receiver, pictures in zip(receivers, found, strict=True):
        told = [(number, receiver.times[number] - pts) for number, pts in pictures if number in receiver.times]
        assert len(told) > 10  # the first ones may come before the channel is open
        # Frames come at uneven times, so that a number told for its neighbour's picture would show.
        assert len({start for _, start in told}) == 1
    for receiver in receivers:
        await receiver.connection.close()
    await soon(lambda: serving.count == 0)


async def test_more_than_there_is_room_for_are_refused(serving, monkeypatch):
    monkeypatch.setattr(peers, "_MOST_PEERS", 1)
    receivers = [Receiver(), Receiver()]
    await receivers[0].connect(serving)
    with pytest.raises(GcsError, match="1 browsers take WebRTC already"):
        await receivers[1].connect(serving)
    assert serving.count == 1
    for receiver in receivers:
        await receiver.connection.close()


@pytest.mark.parametrize(
    "offer", ["", "v=0", "\0\0", "v=0\r\nm=video\r\n", "v=0\r\nm=audio 9 RTP/AVP 0\r\n", "x" * 70_000]
)
async def test_what_is_no_offer_is_one_line_and_leaves_nothing_behind(serving, offer):
    with pytest.raises(GcsError, match="offer") as refused:
        await serving.answer(offer)
    assert "\n" not in str(refused.value)
    assert serving.count == 0


async def test_one_that_never_connects_is_forgotten(serving, monkeypatch):
    monkeypatch.setattr(peer, "_CONNECT_S", 0.02)
    receiver = Receiver()
    await serving.answer(await receiver.offer())
    assert serving.count == 1
    await soon(lambda: serving.count == 0)
    await receiver.connection.close()


async def test_one_that_falls_behind_goes_on_with_a_key_frame(station):
    stream = LiveStream(station, 1000, annotated=False)
    given: list[Coded] = []
    track = peer._Track(stream, given.append)
    first = asyncio.create_task(track.recv())
    await soon(lambda: given and first.done())
    assert given[0].is_key
    while not track._needs_key:  # nothing is taken any more, until there is too much
        await asyncio.sleep(0)
    await track.recv()
    assert given[1].is_key
    assert given[1].seq > given[0].seq + peer._MOST_QUEUED
    track.stop()
    await stream.close()


def test_addresses_that_a_browser_hides_are_not_looked_up():
    known = "a=candidate:2 1 udp 2113937151 192.168.1.7 50001 typ host\r\n"
    assert peer._without_hidden("v=0\r\n" + HIDDEN + known) == "v=0\r\n" + known


async def test_a_page_answers_offers_until_its_station_goes():
    async with web_rig() as rig:
        session, receivers = await rig.session(), [Receiver(), Receiver()]
        for receiver in receivers:
            async with session.post("/webrtc", data=await receiver.offer(), headers={"Origin": rig.base}) as response:
                assert response.status == 200
                answer = await response.text()
        assert "a=sendonly" in answer
        assert "H264/90000" in answer
        assert "VP8" not in answer
        streams = [each for each in rig.station.watchers if isinstance(each, LiveStream)]
        assert len(streams) == 1  # both take the same
        rig.page.detach()
        await soon(lambda: not rig.station.watchers)
        for receiver in receivers:
            await receiver.connection.close()


async def test_an_offer_that_is_none_is_refused_in_one_line():
    async with web_rig() as rig:
        session = await rig.session()
        async with session.post("/webrtc", data="v=0", headers={"Origin": rig.base}) as response:
            assert response.status == 400
            assert "\n" not in await response.text()


async def test_without_aiortc_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "aiortc", None)
    assert not webrtc.is_installed()
    await webrtc.prepare()
    async with web_rig() as rig:
        session = await rig.session()
        async with session.post("/webrtc", data="v=0", headers={"Origin": rig.base}) as response:
            assert response.status == 501
            assert "pip install 'climrt-gcs[webrtc]'" in await response.text()
