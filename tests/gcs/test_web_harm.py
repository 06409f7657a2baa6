"""Browsers that do harm: deaf, flooding, malformed (gcs.operator.web over a real socket)."""

from __future__ import annotations

import asyncio
import json
import socket
import struct

import pytest

from gcs.operator.web.viewer import Viewer
from tests.gcs.web_rig import web_rig


class TestHarm:
    @pytest.mark.parametrize(
        ("message", "code"),
        [
            ("{", 1008), ('{"do":"sing"}', 1008), ('{"do":"abort","x":1}', 1008), (b"\x00\x01", 1003),
            ('{"do":"select","box":[1,2,3,NaN],"frame":1}', 1008),
            (json.dumps({"do": "accept", "name": "x" * 17_000}), 1009), ("[" * 70_000, 1009),
        ],
    )  # fmt: skip
    async def test_what_no_page_sends_closes_only_the_one_that_sent_it(self, message, code):
        async with web_rig() as rig:
            good, bad = await rig.browser(), await rig.browser()
            await (bad.ws.send_bytes if isinstance(message, bytes) else bad.ws.send_str)(message)
            closed, reason = await bad.end()
            assert closed == code
            assert reason or len(message) > 65536
            assert (await good.ask("land"))["ok"]
            assert [type(order).__name__ for order in rig.station.orders] == ["Land"]

    async def test_a_flood_closes_only_the_flooder(self):
        async with web_rig() as rig:
            good, bad = await rig.browser(), await rig.browser()
            for _ in range(302):
                await bad.ws.send_str('{"do":"ping"}')
            assert await bad.end() == (1008, "too many messages")
            assert (await good.ask("land"))["ok"]
            assert len(rig.page._audience) == 1

    async def test_half_a_message_and_gone(self):
        async with web_rig() as rig:
            good, bad = await rig.browser(), await rig.browser()
            bad.ws._response.connection.transport.write(b"\x81\xfe\x10\x00abcd")
            bad.ws._response.connection.transport.abort()
            while len(rig.page._audience) == 2:
                await good.ask("ping")
            assert (await good.ask("land"))["ok"]

    async def test_too_many_are_told_so(self):
        async with web_rig(most_viewers=2) as rig:
            first, _ = await rig.browser(), await rig.browser()
            third = await rig.browser()
            assert await third.end() == (1013, "2 are looking already")
            session = await rig.session()
            async with session.get("/video.mjpg") as response:
                assert response.status == 503
            await first.ws.close()
            while len(rig.page._audience) == 2:
                await asyncio.sleep(0)
            assert (await (await rig.browser()).ask("ping"))["ok"]

    async def test_a_browser_that_never_reads_gets_no_queue(self, monkeypatch):
        """Nothing piles up for it: two pictures on their way, one text of each kind, and the socket's own buffer."""
        viewers: list[Viewer] = []
        run = Viewer.run

        async def kept(self, handle):
            viewers.append(self)
            await run(self, handle)

        monkeypatch.setattr(Viewer, "run", kept)
        async with web_rig(size=(640, 480)) as rig:
            good = await rig.browser()
            deaf = await _deaf(rig)
            await good.ask("ping")
            for number in range(150):
                rig.station.show()
                rig.page.say(f"{number} " + "x" * 4000)
                await good.ask("ping")
                rig.clock.advance(0.05)
                if good.pictures:
                    seq = struct.unpack("<I", good.pictures.pop()[:4])[0]
                    await good.ws.send_str(json.dumps({"do": "seen", "frame": seq}))
            viewer = viewers[1]
            transport = viewer._ws._req.transport
            assert len(viewer._unseen) == 2
            assert len(viewer._lines) <= 200
            assert len(viewer._texts) <= 4
            assert transport.get_write_buffer_size() < 200_000
            assert good.heard["frame"]["frame"] > 130
            deaf.close()

    async def test_the_end_of_the_page_waits_for_no_browser(self):
        async with web_rig() as rig:
            polite, deaf = await rig.browser(), await _deaf(rig)
            async with asyncio.timeout(4.0):
                await rig.page.close()
            assert (await polite.end())[0] == 1001
            deaf.close()


async def _deaf(rig) -> socket.socket:
    """A WebSocket whose owner never reads."""
    loop = asyncio.get_running_loop()
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    sock.setblocking(False)
    await loop.sock_connect(sock, ("127.0.0.1", rig.page.port))
    place = f"127.0.0.1:{rig.page.port}"
    head = (
        f"GET /ws HTTP/1.1\r\nHost: {place}\r\nOrigin: http://{place}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Cookie: station_{rig.page.port}={rig.page.guard.cookie}\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    await loop.sock_sendall(sock, head.encode())
    assert b" 101 " in await loop.sock_recv(sock, 64)
    return sock
