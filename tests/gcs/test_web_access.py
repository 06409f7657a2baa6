"""Who is let in to the page, and what a browser is told to be careful with (gcs.operator.web)."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys

import aiohttp
import pytest

from gcs.clock import FakeClock
from gcs.errors import PageError
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.guard import Guard
from gcs.operator.web.server import Page
from tests.gcs.web_rig import TOKEN, web_rig

HEAVY = ("cv2", "torch", "scipy", "filterpy", "av", "aiortc", "mavsdk", "pymavlink")
ROUTES = ("/", "/ws", "/video.mjpg", "/snapshot.jpg", "/status.json", "/abort", "/webrtc", "/static/app.js")


class TestGuard:
    @pytest.mark.parametrize(
        "host", ["localhost", "LOCALHOST:80", "127.0.0.1:8870", "127.9.9.9", "[::1]:1", "192.0.2.7", "gcs.local"]
    )
    def test_our_own_names_and_addresses(self, host):
        assert Guard(None, ("gcs.local",)).is_our_name(host, "192.0.2.7")

    @pytest.mark.parametrize(
        "host",
        ["", "evil.example", "localhost.evil.example", "192.0.2.8", "0.0.0.0", "127.0.0.1@evil.example", "localhost/x",
         "[::1", "localhost:99999999", "127.0.0.1.evil.example", "gcs.local"],
    )  # fmt: skip
    def test_every_other_is_refused(self, host):
        assert not Guard(None, ()).is_our_name(host, "192.0.2.7")

    @pytest.mark.parametrize(
        "origin", [None, "null", "", "http://evil.example", "http://h:2", "ftp://h:1", "h:1", "http://h:1.evil.example"]
    )
    def test_origins_of_others(self, origin):
        assert not Guard(None, ()).is_our_page(origin, "h:1")

    def test_an_address_by_another_way(self):
        assert Guard(None, ("203.0.113.5",)).is_our_name("203.0.113.5:80", "10.0.0.2")  # forwarded by somebody's router
        assert Guard(None, ()).is_our_name("192.0.2.7:80", "::ffff:192.0.2.7")  # a socket for IPv4 and IPv6
        assert Guard(None, ()).is_our_name("[fe80::1]:80", "fe80::1%eth0")

    def test_our_origin(self):
        assert Guard(None, ()).is_our_page("http://h:1", "H:1")
        assert Guard(None, ()).is_our_page("https://h:1", "h:1")  # behind somebody's TLS

    def test_each_start_has_its_own_token_and_a_given_one_its_own_cookie(self):
        assert Guard(None, ()).token != Guard(None, ()).token
        assert Guard(TOKEN, ()).cookie == Guard(TOKEN, ()).cookie != Guard(TOKEN + "x", ()).cookie
        assert not Guard(TOKEN, ()).is_token("töken\udc80")


async def test_the_token_becomes_a_cookie_and_leaves_the_address():
    async with web_rig() as rig:
        session = await rig.session(known=False)
        async with session.get("/") as response:
            assert response.status == 401
            assert "?token=" in await response.text()
        async with session.get(f"/?token={TOKEN}", allow_redirects=False) as response:
            assert (response.status, response.headers["Location"]) == (303, "/")
            cookie = response.headers["Set-Cookie"]
            assert "HttpOnly" in cookie
            assert "SameSite=Strict" in cookie
            assert TOKEN not in cookie
        async with session.get("/") as response:
            assert response.status == 200
            assert "<html" in (await response.text()).lower()


async def test_a_wrong_token_opens_nothing():
    async with web_rig() as rig:
        session = await rig.session(known=False)
        for path in (
            f"/?token={TOKEN[:-1]}x",
            "/?token=",
            f"/snapshot.jpg?token={TOKEN}x",
            f"/static/app.js?token={TOKEN}",
        ):
            async with session.get(path, allow_redirects=False) as response:
                assert response.status == 401, path
                assert "Set-Cookie" not in response.headers
        async with session.post(f"/abort?token={TOKEN}", headers={"Origin": rig.base}) as response:
            assert response.status == 401
        assert rig.station.orders == []


async def test_programs_without_cookies_may_look_by_the_token():
    async with web_rig() as rig:
        session = await rig.session(known=False)
        for path in ("/snapshot.jpg", "/status.json"):
            async with session.get(f"{path}?token={TOKEN}") as response:
                assert response.status == 200


async def test_a_link_from_elsewhere_asks_once_more_by_itself():
    """A strict cookie is not sent with what another site's link opens, nor with where that is redirected to."""
    async with web_rig() as rig:
        session = await rig.session(known=False)
        async with session.get("/", headers={"Sec-Fetch-Site": "cross-site"}) as response:
            assert response.status == 200
            assert 'http-equiv="refresh"' in await response.text()
        async with session.get("/", headers={"Sec-Fetch-Site": "same-origin"}) as response:
            assert response.status == 401


@pytest.mark.parametrize("path", ROUTES)
async def test_under_a_name_that_is_not_ours_nothing_is_served(path):
    async with web_rig() as rig:
        session = await rig.session()
        async with session.get(path, headers={"Host": f"evil.example:{rig.page.port}"}) as response:
            assert response.status == 403


async def test_a_name_of_the_configuration_is_ours():
    async with web_rig(names=("gcs.local",)) as rig:
        session = await rig.session(known=False)
        async with session.get("/", headers={"Host": f"gcs.local:{rig.page.port}"}) as response:
            assert response.status == 401


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "http://127.0.0.1:1"])
async def test_pages_from_elsewhere_can_neither_speak_nor_abort(origin):
    async with web_rig() as rig:
        session = await rig.session()
        headers = {} if origin is None else {"Origin": origin}
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await session.ws_connect("/ws", headers=headers)
        assert refused.value.status == 403
        for path in ("/abort", "/webrtc"):
            async with session.post(path, headers=headers) as response:
                assert response.status == 403
        assert rig.station.orders == []


async def test_without_cookie_the_right_origin_helps_nobody():
    async with web_rig() as rig:
        session = await rig.session(known=False)
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await session.ws_connect("/ws", origin=rig.base)
        assert refused.value.status == 401
        async with session.post("/abort", headers={"Origin": rig.base}) as response:
            assert response.status == 401


async def test_no_get_changes_anything():
    async with web_rig() as rig:
        session = await rig.session()
        queries = ("", "?do=abort", "?force=true", "?box=1,2,3,4&frame=1")
        for method in ("GET", "HEAD", "PUT", "DELETE", "PATCH", "OPTIONS"):
            for path in ROUTES:
                for query in queries:
                    headers = {"Origin": rig.base, "X-HTTP-Method-Override": "POST"}
                    async with session.request(method, path + query, headers=headers) as response:
                        if path == "/video.mjpg" and method == "GET":
                            assert response.status == 200
                            continue
                        await response.read()
                        assert response.status in (200, 400, 404, 405, 503), (method, path)
        assert rig.station.orders == []
        assert rig.lease.holder(rig.clock.now_s()) == ""


async def test_a_post_that_is_allowed_does_something():
    """So that the test above can fail."""
    async with web_rig() as rig:
        session = await rig.session()
        async with session.post("/abort", headers={"Origin": rig.base}) as response:
            assert await response.json() == {"ok": True, "text": "abort: zero, then hold"}
        assert [type(order).__name__ for order in rig.station.orders] == ["Abort"]
        assert rig.acts == [("page at 127.0.0.1", "abort: zero, then hold")]


async def test_every_answer_tells_the_browser_to_be_careful():
    async with web_rig() as rig:
        session = await rig.session()
        for path in (*ROUTES, "/nothing", "/static/../server.py", "/static/%2e%2e%2fserver.py"):
            async with session.get(path) as response:
                assert "default-src 'none'" in response.headers["Content-Security-Policy"], path
                assert response.headers["X-Frame-Options"] == "DENY"
                assert response.headers["Cache-Control"] == "no-store"
                assert "unsafe" not in response.headers["Content-Security-Policy"]
                if path.endswith("py"):
                    assert response.status == 404


async def test_a_host_header_cannot_add_to_the_policy():
    async with web_rig() as rig:
        reader, writer = await asyncio.open_connection("127.0.0.1", rig.page.port)
        writer.write(b"GET / HTTP/1.1\r\nHost: localhost; script-src *\r\nConnection: close\r\n\r\n")
        answer = (await reader.read()).decode()
        writer.close()
        assert " 403 " in answer
        assert "script-src *" not in answer


async def test_a_taken_port_is_one_line():
    async with web_rig() as rig:
        other = Page(PageConfig(port=rig.page.port), FakeClock(), lease=Lease())
        with pytest.raises(PageError) as refused:
            await other.open()
        text = str(refused.value)
        assert f"127.0.0.1:{rig.page.port}" in text
        assert "in use" in text
        assert "\n" not in text


async def test_an_address_that_is_not_ours_is_one_line():
    with pytest.raises(PageError, match=r"192\.0\.2\.1:0 cannot be served"):
        await Page(PageConfig(host="192.0.2.1", port=0), FakeClock(), lease=Lease()).open()


async def test_routes_of_others_need_no_token_but_our_name():
    async def definition(request: aiohttp.web.Request) -> aiohttp.web.Response:
        return aiohttp.web.Response(text="<camera/>")

    page = Page(PageConfig(port=0), FakeClock(), lease=Lease(), routes=[aiohttp.web.get("/camera.xml", definition)])
    await page.open()
    try:
        base = f"http://127.0.0.1:{page.port}"
        async with aiohttp.ClientSession(base) as session:
            async with session.get("/camera.xml") as response:
                assert await response.text() == "<camera/>"
            async with session.get("/camera.xml", headers={"Host": "evil.example"}) as response:
                assert response.status == 403
    finally:
        await page.close()


async def test_before_a_station_it_says_what_is_waited_for():
    async with web_rig(attached=False) as rig:
        rig.page.starting("waiting for the vehicle\nat udpin://0.0.0.0:14540")
        session = await rig.session()
        async with session.get("/status.json") as response:
            assert json.loads(await response.text()) == {
                "type": "starting",
                "text": "waiting for the vehicle at udpin://0.0.0.0:14540",
            }
        for path in ("/snapshot.jpg",):
            async with session.get(path) as response:
                assert response.status == 503
        async with session.post("/abort", headers={"Origin": rig.base}) as response:
            assert response.status == 503


@pytest.mark.parametrize("module", ["gcs.operator.web.server", "gcs.launch"])
def test_the_page_answers_before_anything_heavy_is_imported(module):
    code = f"import sys, {module}; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
