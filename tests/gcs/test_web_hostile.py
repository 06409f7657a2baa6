"""What somebody on the same network can do to the page: crowd it, stall it, guess, send rubbish (gcs.operator.web)."""

from __future__ import annotations

import asyncio
import contextlib
import logging

import pytest

from gcs.operator.web import connections, mjpeg, webrtc
from gcs.operator.web.limits import Guesses
from tests.gcs.web_rig import SOON_S, TOKEN, WebRig, web_rig


class Line:
    """A bare connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def open(cls, rig: WebRig, source: str = "127.0.0.1") -> Line:
        line = cls(*await asyncio.open_connection("127.0.0.1", rig.page.port, local_addr=(source, 0)))
        rig.stack.callback(line.writer.close)
        return line

    async def asks(self, rig: WebRig, path: str = "/", *, cookie: bool = False, times: int = 1) -> bytes:
        """The head of the first answer; empty: the connection had ended."""
        proof = f"Cookie: station_{rig.page.port}={rig.page.guard.cookie}\r\n" if cookie else ""
        request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{rig.page.port}\r\n{proof}\r\n"
        try:
            self.writer.write(request.encode() * times)
            async with asyncio.timeout(SOON_S):
                return await self.reader.readuntil(b"\r\n\r\n")
        except (ConnectionError, asyncio.IncompleteReadError):
            return b""

    async def rest(self) -> bytes:
        """Until it is closed by the page."""
        with contextlib.suppress(ConnectionError):
            async with asyncio.timeout(SOON_S):
                return await self.reader.read()
        return b""


def status(answer: bytes) -> int:
    return int(answer.split()[1]) if answer else 0


class TestCrowd:
    async def test_one_address_crowds_out_itself_only(self):
        async with web_rig() as rig:
            known = await Line.open(rig)
            assert status(await known.asks(rig, "/static/app.js", cookie=True)) == 200
            await known.reader.readexactly(len(rig.page.files["app.js"].body))
            other = await Line.open(rig, "127.0.0.2")
            crowd = [await Line.open(rig) for _ in range(connections.MOST_STRANGE_OF_ONE + 8)]
            assert status(await crowd[-1].asks(rig)) == 401
            assert await crowd[0].rest() == b""
            assert len(rig.page._connections) <= connections.MOST_STRANGE_OF_ONE + 2
            assert status(await other.asks(rig)) == 401
            assert status(await known.asks(rig, cookie=True)) == 200

    async def test_all_together_the_most_crowded_address_yields(self, monkeypatch):
        monkeypatch.setattr(connections, "MOST_STRANGE", 8)
        async with web_rig() as rig:
            few = [await Line.open(rig, "127.0.0.2") for _ in range(3)]
            many = [await Line.open(rig, "127.0.0.3") for _ in range(12)]
            late = await Line.open(rig, "127.0.0.4")
            assert [status(await line.asks(rig)) for line in (*few, late)] == [401] * 4
            assert await many[0].rest() == b""

    async def test_who_is_known_may_keep_a_few_to_spare(self, monkeypatch):
        monkeypatch.setattr(connections, "MOST_SPARE", 3)
        async with web_rig() as rig:
            looker = await rig.browser()
            lines = [await Line.open(rig) for _ in range(5)]
            for line in lines:
                assert status(await line.asks(rig, "/status.json", cookie=True)) == 200
            assert b"\n" not in await lines[0].rest()
            assert (await looker.ask("ping"))["ok"]

    async def test_a_stranger_has_one_answer(self):
        async with web_rig() as rig:
            line = await Line.open(rig)
            assert status(await line.asks(rig, times=50)) == 401
            assert b"HTTP/1.1" not in await line.rest()

    @pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nA: "])
    async def test_who_does_not_finish_asking_is_not_waited_for(self, monkeypatch, said):
        monkeypatch.setattr(connections, "_IDLE_S", 0.05)
        async with web_rig() as rig:
            line = await Line.open(rig)
            line.writer.write(said)
            assert await line.rest() == b""

    async def test_a_body_that_never_ends_is_not_waited_for(self, monkeypatch):
        monkeypatch.setattr(webrtc, "_BODY_S", 0.05)
        async with web_rig() as rig:
            session = await rig.session()

            async def drips():
                yield b"v=0"
                await asyncio.sleep(SOON_S)

            async with session.post("/webrtc", data=drips(), headers={"Origin": rig.base}) as response:
                assert response.status == 408


class TestGuesses:
    def test_ten_at_once_then_one_in_six_seconds(self):
        guesses = Guesses()
        for number in range(10):
            assert guesses.wait_s("a", 5.0) == 0
            guesses.note("a", str(number), 5.0)
        assert guesses.wait_s("a", 5.0) == pytest.approx(6.0)
        assert guesses.wait_s("b", 5.0) == 0
        assert guesses.wait_s("a", 11.0) == 0
        guesses.note("a", "more", 11.0)
        assert guesses.wait_s("a", 11.0) == pytest.approx(6.0)
        assert guesses.wait_s("a", 3600.0) == 0

    def test_a_page_left_open_guesses_nothing(self):
        guesses = Guesses()
        for second in range(100):
            guesses.note("a", "of an earlier start", second / 10)
        assert guesses.wait_s("a", 10.0) == 0

    def test_many_addresses_fill_no_memory(self):
        guesses = Guesses()
        for number in range(3000):
            guesses.note(str(number), "x", 1.0)
        assert len(guesses._wrong) <= 1000

    async def test_after_too_many_even_the_right_one_has_to_wait_but_never_the_cookie(self):
        async with web_rig() as rig:
            known, stranger = await rig.session(), await rig.session(known=False)
            for number in range(10):
                async with stranger.get(f"/?token=a-wrong-one-{number}") as response:
                    assert response.status == 401
            for path in (f"/?token={TOKEN}", f"/snapshot.jpg?token={TOKEN}"):
                async with stranger.get(path, allow_redirects=False) as response:
                    assert (response.status, response.headers["Retry-After"]) == (429, "6")
                    assert await response.text() == "Too many wrong links from your address: wait 6 s.\n"
            async with known.get("/") as response:
                assert response.status == 200
            async with known.post("/abort", headers={"Origin": rig.base}) as response:
                assert response.status == 200
            rig.clock.advance(6.1)
            async with stranger.get(f"/?token={TOKEN}") as response:
                assert response.status == 200


class TestRubbish:
    async def test_pings_are_messages_too(self):
        async with web_rig() as rig:
            browser = await rig.browser()
            await browser.ws.ping(b"once")
            assert (await browser.ask("ping"))["ok"]
            with contextlib.suppress(ConnectionError):
                for _ in range(400):
                    await browser.ws.ping()
            assert (await browser.end())[1] == "too many messages"

    @pytest.mark.parametrize(
        ("body", "headers"),
        [
            (b"", {}), (b"v=0", {}), (b"\xff\xfe\xfd", {}), (b"v=0", {"Content-Encoding": "gzip"}),
            (b"v=0", {"Content-Type": "text/plain; charset=rot13"}), (b"x" * 60_000, {}), (b"m=video\r\n" * 5000, {}),
            (b"v=0\r\nm=video 9 UDP/TLS/RTP/SAVPF 96\r\na=candidate:1 1 udp 1 x.LOCAL 9 typ host\r\n", {}),
        ],
    )  # fmt: skip
    async def test_what_is_no_offer_is_refused_in_one_line(self, caplog, body, headers):
        async with web_rig() as rig:
            session = await rig.session()
            async with session.post("/webrtc", data=body, headers={"Origin": rig.base, **headers}) as response:
                assert response.status == 400
                text = await response.text()
            assert "offer" in text
            assert "\n" not in text
        assert not caplog.records

    async def test_what_is_no_http_is_not_logged(self, caplog):
        async with web_rig() as rig:
            for rubbish in (b"\x16\x03\x01\x02\0\x01", b"GET / HTTP/1.1\r\n\xff\xfe\r\n\r\n", b"GET /\r\n\r\n"):
                line = await Line.open(rig)
                line.writer.write(rubbish)
                line.writer.write_eof()
                await line.rest()
            first, second = (
                b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
                b"BREW / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
            )
            line = await Line.open(rig)
            line.writer.write(first + second)
            assert b" 40" in await line.rest()
        assert not [record for record in caplog.records if record.levelno >= logging.INFO]

    async def test_a_fault_of_ours_is_logged_and_ends_nothing(self, caplog, monkeypatch):
        async with web_rig() as rig:
            session = await rig.session()
            monkeypatch.setattr(rig.page._stage.feed, "status", lambda: 1 / 0)
            async with session.get("/status.json") as response:
                assert response.status == 500
                assert "see its log" in await response.text()
            assert "ZeroDivisionError" in caplog.text

    async def test_who_looked_at_nothing_and_left_frees_its_place(self, monkeypatch):
        monkeypatch.setattr(mjpeg, "_LOOK_S", 0.02)
        async with web_rig(attached=False, most_viewers=1) as rig:
            session = await rig.session()
            async with session.get("/video.mjpg") as response:
                assert response.status == 200
                assert len(rig.page._audience) == 1
            async with asyncio.timeout(SOON_S):
                while len(rig.page._audience):
                    await asyncio.sleep(0.01)
            await (await rig.browser(session)).hear("starting")
