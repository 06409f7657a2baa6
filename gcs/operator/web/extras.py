"""Video by WebRTC, where its extra is installed; without it the page shows single pictures."""

from __future__ import annotations

import asyncio
import importlib
import importlib.util
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

from aiohttp import web

from gcs.errors import GcsError

if TYPE_CHECKING:
    from gcs.operator.station import Station

_NAME: Final = "gcs.operator.web.webrtc"
_BODY_S: Final = 5.0


def has_webrtc() -> bool:
    """It can be asked for."""
    module = _module()
    return module is not None and bool(module.is_installed())


async def offer_of(request: web.Request) -> str:
    """The browser's offer, or a refusal in one line."""
    try:
        async with asyncio.timeout(_BODY_S):
            return (await request.read()).decode()
    except TimeoutError:
        raise web.HTTPRequestTimeout(text="the offer did not come") from None
    except (web.RequestPayloadError, ValueError):
        raise web.HTTPBadRequest(text="that is no offer") from None


async def answer_webrtc(station: Station, offer_sdp: str) -> web.Response:
    """The SDP answer to a browser's offer, or why there is none."""
    module: Any = _module()
    if module is None or not module.is_installed():
        raise web.HTTPNotImplemented(text="WebRTC is not installed: pip install 'climrt-gcs[webrtc]'")
    try:
        answer = await module.answer(station, offer_sdp)
    except (GcsError, ValueError) as error:
        raise web.HTTPBadRequest(text=str(error)) from None
    return web.Response(text=answer, content_type="application/sdp")


async def close_webrtc() -> None:
    """End all of them."""
    import sys

    module: Any = sys.modules.get(_NAME)  # never loaded: nothing to end
    if module is not None:
        await module.close_all()


def _module() -> ModuleType | None:
    return importlib.import_module(_NAME) if importlib.util.find_spec(_NAME) is not None else None
