"""Clients of the RTSP server that are slow, rude, silent or too many: nobody else notices."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable

import pytest_asyncio

from gcs.clock import FakeClock
from gcs.video_out.rtsp_server import RtspServer

PICTURE = [b"\x80" + bytes(1199)] * 90  # about 100 kB


class Serving:
    """The server, and how often it said that somebody came or went."""

    def __init__(self) -> None:
        self.clock = FakeClock(100.0)
        self.changes = 0
        self.server = RtspServer(lambda: "v=0\r\n", self._changed, self.clock.now_s)

    def _changed(self) -> None:
        self.changes += 1

    async def connect(self, source: str = "127.0.0.1") -> Client:
        return Client(
            *await asyncio.open_connection("127.0.0.1", self.server.port, limit=2**20, local_addr=(source, 0))
        )

    async def until(self, is_so: Callable[[], object]) -> None:
        async with asyncio.timeout(10):
            while not is_so():
                await asyncio.sleep(0.002)


class Client:
    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    async def ask(self, method: str, transport: str = "") -> bytes:
        extra = f"Transport: {transport}\r\n" if transport else ""
        self.writer.write(f"{method} rtsp://127.0.0.1/live RTSP/1.0\r\nCSeq: 1\r\n{extra}\r\n".encode())
        return await asyncio.wait_for(self.reader.readuntil(b"\r\n\r\n"), 10)

    async def play(self, transport: str = "RTP/AVP/TCP;unicast;interleaved=2-3") -> bytes:
        answer = await self.ask("SETUP", transport)
        assert b"200 OK" in await self.ask("PLAY")
        return answer

    async def packets(self, count: int) -> list[bytes]:
        found = []
        for _ in range(count):
            head = await asyncio.wait_for(self.reader.readexactly(4), 10)
            assert head[:2] == b"$\x02"
            found.append(await self.reader.readexactly(int.from_bytes(head[2:], "big")))
        return found

    async def is_gone(self) -> bool:
        """The server has ended it."""
        async with asyncio.timeout(10):
            with contextlib.suppress(ConnectionError):
                while await self.reader.read(65536):
                    pass
        return True


@pytest_asyncio.fixture
async def serving() -> AsyncIterator[Serving]:
    serving = Serving()
    await serving.server.open("127.0.0.1", 0)
    yield serving
    await serving.server.close()


async def test_one_who_does_not_read_loses_pictures_then_the_connection_and_the_others_lose_nothing(serving):
    slow, quick = await serving.connect(), await serving.connect()
    await slow.play()
    await quick.play()
    slow.writer.transport.pause_reading()
    for _ in range(100):  # 10 MB
        serving.server.send(PICTURE, True)
        assert await quick.packets(len(PICTURE)) == PICTURE
    assert serving.server.players == 2
    serving.clock.advance(7.9)
    serving.server.sweep()
    assert serving.server.players == 2
    serving.clock.advance(0.2)
    serving.server.sweep()
    await serving.until(lambda: serving.server.players == 1)
    serving.server.send(PICTURE, False)
    assert await quick.packets(len(PICTURE)) == PICTURE


async def test_after_pictures_were_lost_the_next_one_is_a_key_frame(serving):
    client = await serving.connect()
    await client.play()
    serving.server.send([b"before"], False)
    client.writer.transport.pause_reading()
    for _ in range(100):
        serving.server.send(PICTURE, True)
        await asyncio.sleep(0)
    client.writer.transport.resume_reading()
    found = b""
    while not found.endswith(b"after"):
        serving.server.send([b"lost"], False)
        serving.server.send([b"after"], True)
        found = (await client.packets(1))[0]
        assert found not in (b"before", b"lost")
    assert serving.server.players == 1


async def test_udp_goes_out_of_the_ports_that_were_told_and_reports_keep_the_session(serving):
    client = await serving.connect()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rtp,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rtcp,
    ):
        rtp.bind(("127.0.0.1", 0))
        rtcp.bind(("127.0.0.1", 0))
        ports = f"{rtp.getsockname()[1]}-{rtcp.getsockname()[1]}"
        answer = await client.play(f"RTP/AVP;unicast;client_port={ports}")
        ours = serving.server.udp_ports
        assert f"client_port={ports};server_port={ours[0]}-{ours[1]}".encode() in answer
        assert (ours[0] % 2, ours[1]) == (0, ours[0] + 1)
        serving.server.send([b"one", b"two"], True)
        rtp.settimeout(5)
        assert rtp.recvfrom(100) == (b"one", ("127.0.0.1", ours[0]))
        assert rtp.recv(100) == b"two"
        serving.clock.advance(50)
        rtcp.sendto(b"report", ("127.0.0.1", ours[1]))
        await serving.until(lambda: serving.server.heard_s == serving.clock.now_s())
        serving.clock.advance(50)
        serving.server.sweep()
        assert serving.server.players == 1
    serving.clock.advance(11)  # 61 s without a word
    serving.server.sweep()
    assert await client.is_gone()
    await serving.until(lambda: serving.server.players == 0)


async def test_whoever_only_connects_is_sent_away(serving):
    client = await serving.connect()
    assert b"200 OK" in await client.ask("OPTIONS")
    serving.clock.advance(15.1)
    serving.server.sweep()
    assert await client.is_gone()


async def test_a_ninth_finds_no_room_until_another_leaves(serving):
    clients = [await serving.connect() for _ in range(8)]
    for client in clients:
        await client.play()
    assert await (await serving.connect()).is_gone()
    assert b"200 OK" in await clients[0].ask("TEARDOWN")
    assert await clients[0].is_gone()
    assert b"200 OK" in await (await serving.connect()).ask("OPTIONS")


async def test_who_plays_nothing_keeps_nobody_out(serving):
    player = await serving.connect()
    await player.play()
    idle = [await serving.connect() for _ in range(7)]
    for client in idle:  # as if it were about to play at last
        assert b"200 OK" in await client.ask("OPTIONS")
    assert b"200 OK" in await (await serving.connect()).ask("OPTIONS")
    assert await idle[0].is_gone()
    assert b"200 OK" in await player.ask("GET_PARAMETER")


async def test_one_host_cannot_take_all_places(serving):
    crowd = [await serving.connect() for _ in range(8)]
    for client in crowd:
        await client.play()
    late = await serving.connect("127.0.0.2")
    await late.play()
    assert await crowd[0].is_gone()
    serving.server.send([b"picture"], True)
    assert await late.packets(1) == await crowd[1].packets(1) == [b"picture"]


async def test_rude_ones_are_cut_off_and_the_others_go_on(serving):
    good = await serving.connect()
    await good.play()
    for said in (
        b"A" * 100_000,
        b"\r\n" * 500_000 + b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n" * 1000,
        b"GET / HTTP/1.1\r\n\r\n",
    ):
        rude = await serving.connect()
        with contextlib.suppress(ConnectionError):
            rude.writer.write(said)
            await rude.writer.drain()
        assert await rude.is_gone()
    serving.server.send([b"still"], True)
    assert await good.packets(1) == [b"still"]
    assert serving.server.players == 1
