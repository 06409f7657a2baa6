"""The video that goes out, as real receivers get it: PyAV, OpenCV, plain sockets."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import socket
import sys
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import av
import cv2
import numpy as np
import pytest

from control.engagement import State
from gcs.errors import GcsError, WireError
from gcs.operator.config import VideoOutConfig
from gcs.video_out import VideoOut, live
from gcs.video_out.encoder import Coded, nal_units
from gcs.video_out.live import LiveStream
from tests.gcs.numbered import NumberedStation, number_of
from tests.gcs.wire_peer import free_port

SIZE = (640, 480)
RAW = VideoOutConfig(rtsp_port=0, annotated=False)
T = TypeVar("T")


@contextlib.asynccontextmanager
async def serving(config: VideoOutConfig, station: NumberedStation, fps: float = 80.0) -> AsyncIterator[VideoOut]:
    out = VideoOut(config, station)
    await out.open()
    running = asyncio.create_task(station.run(fps))
    yield out
    running.cancel()
    await out.close()


async def in_thread(work: Callable[..., T], *args: Any) -> T:
    with ThreadPoolExecutor(1) as own:
        return await asyncio.wait_for(asyncio.get_running_loop().run_in_executor(own, work, *args), 20)


async def soon(is_so: Callable[[], object]) -> None:
    async with asyncio.timeout(10):
        while not is_so():
            await asyncio.sleep(0.005)


def read_av(address: str, **options: str) -> list[int]:
    """The numbers of the first five pictures."""
    with av.open(address, options=options, timeout=10) as container:
        frames = container.decode(video=0)
        return [number_of(next(frames).to_ndarray(format="bgr24")) for _ in range(5)]


def read_cv(url: str) -> list[int]:
    capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG)
    numbers = [number_of(capture.read()[1]) for _ in range(5)]
    capture.release()
    return numbers


def follow_each_other(numbers: list[int]) -> bool:
    return all(0 < after - before <= 40 for before, after in itertools.pairwise(numbers))


async def test_two_programs_take_it_at_once_by_tcp_and_by_udp(monkeypatch):
    monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", "rtsp_transport;udp")
    async with serving(RAW, NumberedStation(SIZE)) as out:
        url = out.rtsp_url
        by_tcp, by_udp = await asyncio.gather(
            in_thread(lambda: read_av(url, rtsp_transport="tcp")), in_thread(read_cv, url)
        )
    assert follow_each_other(by_tcp)
    assert follow_each_other(by_udp)


async def test_rtp_goes_to_its_address_unasked_and_the_sdp_tells_how_to_read_it(tmp_path: Path):
    config = VideoOutConfig(rtp=f"127.0.0.1:{free_port()}")
    async with serving(config, NumberedStation(SIZE)) as out:
        path = tmp_path / "live.sdp"
        path.write_text(out.sdp() or "")
        assert out.rtsp_url is None
        numbers = await in_thread(lambda: read_av(str(path), protocol_whitelist="file,udp,rtp"))
    assert follow_each_other(numbers)  # although annotated: the blocks stand beneath the banner


class Client:
    """RTSP by hand, over TCP."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def connect(cls, out: VideoOut) -> Client:
        port = int((out.rtsp_url or "").split(":")[2].split("/")[0])
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    async def ask(self, method: str, *headers: str) -> str:
        lines = (f"{method} rtsp://127.0.0.1/live RTSP/1.0", "CSeq: 1", *headers, "", "")
        self.writer.write("\r\n".join(lines).encode())
        return (await self.reader.readuntil(b"\r\n\r\n")).decode()

    async def play(self) -> None:
        assert "200 OK" in await self.ask("SETUP", "Transport: RTP/AVP/TCP;unicast;interleaved=0-1")
        assert "200 OK" in await self.ask("PLAY")

    async def packet(self) -> bytes:
        head = await self.reader.readexactly(4)
        assert head[:2] == b"$\0"
        return await self.reader.readexactly(int.from_bytes(head[2:], "big"))


async def test_it_is_encoded_only_while_somebody_takes_it_who_gets_a_key_frame_first():
    station = NumberedStation(SIZE)
    async with serving(RAW, station) as out:
        await soon(lambda: station.frames.newest and station.frames.newest.seq > 10)
        assert out.encoded == 0
        first = await Client.connect(out)
        await first.play()
        for _ in range(20):
            await first.packet()
        second = await Client.connect(out)  # between two key frames of the first
        await second.play()
        start = await second.packet()
        assert start[1] & 0x7F == 96
        assert start[12] & 0x1F == 24  # STAP-A: several units in one packet
        assert start[15] & 0x1F == 7  # of which the first is the SPS
        first.writer.close()
        second.writer.close()
        await soon(lambda: not out.viewers)
        encoded, seen = out.encoded, station.frames.newest.seq
        await soon(lambda: station.frames.newest.seq > seen + 10)
        assert out.encoded <= encoded + 1  # the one that was under way


async def test_a_port_that_is_taken_and_a_host_that_is_not_known_are_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(WireError, match=f"^RTSP at 127.0.0.1:{port}: .*in use"):
            await VideoOut(VideoOutConfig(rtsp_port=port), NumberedStation(SIZE)).open()
    with pytest.raises(WireError, match=r"^RTP to nowhere\.invalid:5600: "):
        await VideoOut(VideoOutConfig(rtp="nowhere.invalid:5600"), NumberedStation(SIZE)).open()


def test_without_pyav_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(GcsError, match=r"pip install climrt-gcs\[video\]$"):
        VideoOut(RAW, NumberedStation(SIZE))


# -- the encoded stream itself -------------------------------------------------------------------------------


class Taken(list[Coded]):
    """What came out, decoded where wanted."""

    def __init__(self) -> None:
        super().__init__()
        self.decoder: Any = av.CodecContext.create("h264", "r")

    def pictures(self) -> list[np.ndarray]:
        return [
            frame.to_ndarray(format="bgr24") for coded in self for frame in self.decoder.decode(av.Packet(coded.data))
        ]


@contextlib.asynccontextmanager
async def streaming(station: NumberedStation, **options: Any) -> AsyncIterator[tuple[LiveStream, Taken]]:
    stream, taken = LiveStream(station, 2000, **{"annotated": False, **options}), Taken()
    stream.take(taken.append)
    yield stream, taken
    await stream.close()


async def shown(station: NumberedStation, taken: Taken, times: int = 1) -> None:
    """So many more, each taken before the next one comes."""
    for _ in range(times):
        have = len(taken)
        station.show()
        await soon(lambda have=have: len(taken) > have)


def kinds(coded: Coded) -> list[int]:
    return [unit[0] & 0x1F for unit in nal_units(coded.data)]


async def test_a_key_frame_comes_first_and_each_second_and_when_asked_for_but_not_more_often():
    now = [100.0]
    station = NumberedStation(SIZE, now_s=lambda: now[0])
    async with streaming(station, now_s=lambda: now[0]) as (stream, taken):
        for ask in (True, True, False, False, False, False, False, True):
            if ask:
                stream.want_key()
            await shown(station, taken)
            now[0] += 0.25
    assert [coded.is_key for coded in taken] == [True, True, False, False, False, True, False, True]
    assert {7, 8, 5} <= set(kinds(taken[0]))  # SPS, PPS and the picture
    assert [coded.ticks for coded in taken] == [9_000_000 + 22_500 * i for i in range(8)]


async def test_the_newest_picture_wins():
    station = NumberedStation(SIZE)
    async with streaming(station) as (stream, taken):
        for _ in range(30):
            station.show()  # with no turn of the loop in between
        await soon(lambda: taken and taken[-1].seq == 30)
        assert stream.replaced >= 20
        assert stream.replaced + len(taken) == 30


async def test_pictures_may_change_their_size_and_odd_ones_lose_a_row():
    station = NumberedStation((641, 481))
    async with streaming(station) as (_, taken):
        await shown(station, taken)
        station.size = SIZE
        await shown(station, taken)
    assert [coded.is_key for coded in taken] == [True, True]
    assert [picture.shape for picture in taken.pictures()] == [(480, 640, 3)] * 2


async def test_the_bit_rate_is_kept_when_pictures_come_more_often_than_at_first():
    now = [100.0]
    station = NumberedStation(SIZE, now_s=lambda: now[0])
    station.base = replace(station.base, video_fps=5.0)
    async with streaming(station, now_s=lambda: now[0]) as (_, taken):
        await shown(station, taken)
        station.base = replace(station.base, video_fps=30.0)
        await shown(station, taken)
        now[0] += 1.0
        await shown(station, taken)
        now[0] += 1.0
        await shown(station, taken)
    first, between, second, third = taken
    assert not between.is_key  # it is changed only where a key frame is due anyway
    assert nal_units(first.data)[0] != nal_units(second.data)[0] == nal_units(third.data)[0]
    assert [number_of(picture) for picture in taken.pictures()] == [1, 2, 3, 4]


async def test_where_no_picture_comes_any_more_the_state_still_does():
    now = [100.0]
    station = NumberedStation(SIZE, now_s=lambda: now[0])
    async with streaming(station, now_s=lambda: now[0], annotated=True) as (stream, taken):
        await shown(station, taken)
        now[0] += 0.5
        stream.ticked(None)
        await soon(lambda: stream.is_idle)
        assert len(taken) == 1
        now[0] += 0.6
        station.base = replace(station.base, state=State.NO_VIDEO)
        stream.ticked(None)
        await soon(lambda: len(taken) == 2)
    before, after = taken.pictures()
    assert number_of(before) == number_of(after) == 1
    assert np.abs(before[:28].astype(int) - after[:28]).max() > 100  # IDLE became NO VIDEO


async def test_what_cannot_be_encoded_is_one_line_and_the_next_picture_is_tried(monkeypatch):
    class Broken:
        def __init__(self, *args: object) -> None:
            raise GcsError("video out: no")

    station = NumberedStation(SIZE)
    async with streaming(station) as (stream, taken):
        with monkeypatch.context() as patched:
            patched.setattr(live, "Encoder", Broken)
            station.show()
            await soon(lambda: stream.problem == "video out: no")
        await shown(station, taken)
        assert stream.problem is None


def test_times_of_a_recording_are_moved_to_now_and_never_go_back():
    clock = live._MediaClock()
    assert clock.ticks(0.0, 50.0) == 4_500_000
    assert clock.ticks(0.1, 50.2) == 4_509_000
    assert clock.ticks(7.0, 50.3) == 4_527_000  # a jump
    assert clock.ticks(7.0, 50.3) == 4_527_001
