"""Rubbish for everything that listens: WebSocket, HTTP and RTSP of strangers, datagrams to the MAVLink camera.

Nothing may break or grow, and nothing may be performed that was not asked for validly.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import math
import random
from collections.abc import Awaitable, Callable
from typing import Final

import aiohttp

from gcs.clock import FakeClock
from gcs.framing import Encoder, dialect
from gcs.operator import orders
from gcs.operator.camera.component import CameraComponent
from gcs.operator.camera.intake import Intake
from gcs.operator.camera.orders import Ask
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.server import Page
from gcs.video_out.rtsp import HostileError, RtspConnection, Udp
from tests.fuzz.process import Usage
from tests.fuzz.report import Progress, Row
from tests.gcs.fake_station import FakeStation

_GROWTH_MB: Final = 15.0
_WARM_FRAC: Final = 0.3
_ANSWER_S: Final = 5.0
_HEAD_S: Final = 0.2
_SIZE: Final = (320, 240)
_WORDS: Final = (b"", b"\0", b"\r\n", b"\r\n\r\n", b" ", b":", b"%2e%2e/", b"9" * 40, b"-1", b"NaN", b"1e999", b"null",
                 b"{", b'"', b"[" * 50, b"\xff\xfe", b"A" * 3000, b"chunked", b"Host: evil.example\r\n")  # fmt: skip
_MESSAGES: Final = (
    {"do": "select", "box": [10, 10, 50, 40], "frame": 1}, {"do": "point", "x": 20, "y": 30.5, "frame": 1},
    {"do": "candidate", "number": 1}, {"do": "take", "force": True}, {"do": "confirm"}, {"do": "hold_begin"},
    {"do": "step", "m": -2.5}, {"do": "standoff", "m": 12}, {"do": "mode", "mode": "follow"}, {"do": "abort", "id": 3},
    {"do": "seen", "frame": 7}, {"do": "accept", "name": "COM_OF_LOSS_T"}, {"do": "record", "on": None},
)  # fmt: skip
_PATHS: Final = ("/", "/ws", "/abort", "/webrtc", "/status.json", "/snapshot.jpg", "/static/app.js", "/video.mjpg")
_RTSP: Final = (
    "OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n", "DESCRIBE rtsp://h/live RTSP/1.0\r\nCSeq: 2\r\n\r\n",
    "SETUP rtsp://h/live/track0 RTSP/1.0\r\nCSeq: 3\r\nTransport: RTP/AVP;unicast;client_port=5000-5001\r\n\r\n",
    "PLAY rtsp://h/live RTSP/1.0\r\nCSeq: 4\r\n\r\n", "TEARDOWN rtsp://h/live RTSP/1.0\r\nCSeq: 5\r\n\r\n",
)  # fmt: skip

Case = Callable[[int, random.Random], Awaitable[str]]


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, cut out, doubled, or replaced by what parsers stumble over."""
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(len(data) + 1)
        end = min(len(data), at + rng.choice((0, 1, 4, 30)))
        piece = rng.choice((rng.randbytes(rng.randrange(6)), data[at:end] * 2, rng.choice(_WORDS)))
        data = data[:at] + piece + data[end:]
    return data


def fuzz_listeners(count: int, seed: int, *, quiet: bool = True) -> list[Row]:
    """`count` pieces of rubbish for each of the four."""
    return asyncio.run(_run(count, seed, quiet))


async def _run(count: int, seed: int, quiet: bool) -> list[Row]:
    clock = FakeClock(1000.0)
    station = FakeStation(_SIZE, now_s=clock.now_s)
    page = Page(PageConfig(port=0), clock, lease=Lease())
    await page.open()
    page.attach(station)
    station.show()
    try:
        return [
            await _row("WebSocket messages", count, seed, quiet, _websocket(page, station)),
            await _row("HTTP requests", count, seed, quiet, _http(page, station, clock)),
            await _row("RTSP requests", count, seed, quiet, _rtsp()),
            await _row("camera datagrams", count, seed, quiet, _camera()),
        ]
    finally:
        await page.close()


async def _row(what: str, count: int, seed: int, quiet: bool, case: Case) -> Row:
    row, progress, warm, noted = Row(what), Progress(what, count, quiet), Usage.now(), dict[str, int]()
    for number in range(count):
        if number == int(_WARM_FRAC * count):
            gc.collect()
            warm = Usage.now()
        try:
            outcome = await case(number, random.Random(f"{seed} {what} {number}"))
        except AssertionError as error:
            row.problem(f"number {number}: {error}")
        except Exception as error:  # noqa: BLE001 - whatever leaves is a finding
            row.problem(f"number {number}: {error!r}")
        else:
            noted[outcome] = noted.get(outcome, 0) + 1
        row.count += 1
        progress.at(row.count)
    gc.collect()
    await asyncio.sleep(0.05)
    end = Usage.now()
    row.seconds, row.rss_warm_mb, row.rss_end_mb = progress.seconds, warm.rss_mb, end.rss_mb
    row.note = ", ".join(f"{number} {outcome}" for outcome, number in sorted(noted.items()))
    if end.rss_mb - warm.rss_mb > _GROWTH_MB or end.handles > warm.handles + 4 or end.threads > warm.threads:
        row.problem(f"grew from {warm} to {end}")
    if len(noted) < 2:
        row.problem("all came out alike: the damage was not put to the test")
    return row


def _websocket(page: Page, station: FakeStation) -> Case:
    base = f"http://127.0.0.1:{page.port}"
    cookie = {"Cookie": f"station_{page.port}={page.guard.cookie}"}

    async def case(number: int, rng: random.Random) -> str:
        text = json.dumps({"id": number, **rng.choice(_MESSAGES)}).encode()
        text = damaged(text, rng) if rng.random() < 0.9 else text
        station.orders.clear()
        async with (
            aiohttp.ClientSession(headers=cookie) as session,
            session.ws_connect(f"{base}/ws", origin=base) as ws,
        ):
            with contextlib.suppress(ConnectionError):
                await (ws.send_bytes(text) if rng.random() < 0.1 else ws.send_str(text.decode(errors="replace")))
                await ws.send_str('{"id":9007199254740991,"do":"ping"}')
            outcome = await _answered(ws)
        done = {type(order) for order in station.orders}
        assert not done & {orders.Confirm, orders.Quit}, f"{text!r}: {done}"
        assert not done or outcome == "taken", f"{text!r}: {outcome}, and yet {done}"
        return outcome

    return case


async def _answered(ws: aiohttp.ClientWebSocketResponse) -> str:
    async with asyncio.timeout(_ANSWER_S):
        async for message in ws:
            if message.type is aiohttp.WSMsgType.TEXT and b"9007199254740991" in message.data.encode():
                return "taken"
    assert ws.close_code in (1003, 1006, 1007, 1008, 1009), ws.close_code
    return "closed"


def _http(page: Page, station: FakeStation, clock: FakeClock) -> Case:
    host = f"127.0.0.1:{page.port}"

    async def case(number: int, rng: random.Random) -> str:
        clock.advance(10.0)  # tokens are looked at again
        method, path = rng.choice(("GET", "POST", "HEAD", "PUT")), rng.choice(_PATHS)
        proof = rng.choice(("", f"Cookie: station_{page.port}={'0' * 64}\r\n", f"Cookie: x={page.guard.cookie}\r\n"))
        query = rng.choice(("", "?token=a-wrong-one", "?token="))
        more = rng.choice(("", "Content-Length: 3\r\n", "Transfer-Encoding: chunked\r\n", "Upgrade: websocket\r\n"))
        head = f"{method} {path}{query} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n{proof}{more}\r\n"
        body = "v=0" if "Length" in more else "3\r\nv=0\r\n0\r\n\r\n" if "chunked" in more else ""
        data = (head + body).encode()
        answer = await _raw(page.port, damaged(data, rng) if rng.random() < 0.7 else data)
        status = answer.split(b" ", 2)[1].decode() if answer.startswith(b"HTTP/1") else "nothing"
        assert not station.orders, f"{head!r}: {station.orders}"
        assert status in ("nothing", "400", "401", "403", "404", "405", "413", "417", "429"), (
            f"{head!r}: {answer[:300]!r}"
        )
        return status

    station.orders.clear()
    return case


async def _raw(port: int, data: bytes) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(data + b"\r\n\r\n")
        async with asyncio.timeout(_HEAD_S):  # some are never finished
            return await reader.read(65_536)
    except (ConnectionError, TimeoutError):
        return b""
    finally:
        writer.transport.abort()


def _rtsp() -> Case:
    async def case(number: int, rng: random.Random) -> str:
        connection = RtspConnection("session", lambda: "v=0\r\n", (6000, 6001), 0.0)
        said, t_s = b"", 0.0
        for step in range(rng.randrange(1, 8)):
            piece = _RTSP[min(step, len(_RTSP) - 1)].encode()
            piece = damaged(piece, rng) if rng.random() < 0.2 else piece
            said, t_s = said + piece, t_s + 0.1
            try:
                answer = connection.receive(piece, t_s)
            except HostileError:
                return "hostile"
            assert answer == b"" or answer.startswith(b"RTSP/1.0 "), answer
            assert len(connection._buffer) < 8192, "the buffer grows"
            assert not connection.playing or (b"PLAY " in said and connection.transport is not None), said
            udp = connection.transport
            assert not isinstance(udp, Udp) or min(udp.rtp_port, udp.rtcp_port) >= 1024, said
            if connection.ended:
                return "ended"
        return "playing" if connection.playing else "quiet"

    return case


def _camera() -> Case:
    clock = FakeClock(1000.0)
    station = FakeStation(_SIZE, now_s=clock.now_s)
    component, intake = CameraComponent(CameraSetup(7), station, Lease(), clock.now_s()), Intake()
    station.show()
    allowed = (orders.Select, orders.SelectPoint, orders.Deselect, orders.Record, orders.SetMode, orders.SetStandoff)

    async def case(number: int, rng: random.Random) -> str:
        clock.advance(6.0)
        good = Encoder(rng.randrange(1, 256), 190).encode(_wish(rng))
        data = damaged(good, rng) if rng.random() < 0.6 else good
        peer = f"10.0.0.{rng.randrange(40)}", 14550
        found = []
        for message in intake.messages(data, peer, clock.now_s(), known=component.knows(peer)):
            found += component.received(message, peer, clock.now_s())
        found += component.tick(clock.now_s())
        asks = [each for each in found if isinstance(each, Ask)]
        for ask in asks:
            assert isinstance(ask.order, allowed), ask.order
            assert good in data, f"a damaged datagram became {ask.order}"
            if isinstance(ask.order, orders.Select):
                assert ask.order.box.is_valid, ask.order
                assert all(map(math.isfinite, ask.order.box.xywh)), ask.order
            await station.perform(ask.order)
            component.settled(ask, None, clock.now_s())
        return "performed" if asks else "nothing"

    return case


def _wish(rng: random.Random) -> object:
    if rng.random() < 0.3:
        name = rng.choice((b"FOLLOW", b"FOLLOW_MODE", b"FOLLOW_STANDOFF", b"HEIGHT", rng.randbytes(6)))
        value = rng.choice((b"\1", b"\0\0 A", rng.randbytes(4)))
        return dialect.MAVLink_param_ext_set_message(7, 100, name, value, rng.choice((1, 9, 200)))
    params = [rng.choice((0.0, 0.25, 0.5, 1.0, -1.0, math.nan, math.inf, 1e30, rng.random())) for _ in range(7)]
    number = rng.choice((2004, 2005, 2010, 2500, 511, 512, 521, 2504, 400, 176, 192, 21))
    return dialect.MAVLink_command_long_message(7, 100, number, 0, *params)
