"""Video by WebRTC, where its extra is installed; without it the page shows single pictures."""

from __future__ import annotations

import asyncio
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from aiohttp import web

from gcs.errors import GcsError

if TYPE_CHECKING:  # brings OpenCV
    from gcs.video_out.peers import Peers

_BODY_S: Final = 5.0


def is_installed() -> bool:
    """Whether `pip install climrt-gcs[webrtc]` was done."""
    return find_spec("aiortc") is not None and find_spec("av") is not None


async def prepare() -> None:
    """Load what it needs, which stops the event loop for some 0.05 s: better before a flight than in it."""
    if is_installed():
        from gcs.video_out.peers import load

        await load()


async def answer(peers: Peers | None, request: web.Request) -> web.Response:
    """The SDP answer to a browser's offer, or in one line why there is none. peers: None without the extra."""
    if peers is None:
        raise web.HTTPNotImplemented(text="WebRTC is not installed: pip install 'climrt-gcs[webrtc]'")
    offer_sdp = await _offer_of(request)
    try:
        answer_sdp = await peers.answer(offer_sdp)
    except GcsError as error:
        raise web.HTTPBadRequest(text=str(error)) from None
    return web.Response(text=answer_sdp, content_type="application/sdp")


async def _offer_of(request: web.Request) -> str:
    try:
        async with asyncio.timeout(_BODY_S):
            return (await request.read()).decode()
    except TimeoutError:
        raise web.HTTPRequestTimeout(text="the offer did not come") from None
    except (web.RequestPayloadError, ValueError):
        raise web.HTTPBadRequest(text="that is no offer") from None
