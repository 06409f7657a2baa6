"""Lets in who may come: name, token or cookie, origin; and the headers that keep a browser careful."""

from __future__ import annotations

import asyncio
import logging
import math
from typing import Final

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from gcs.clock import Clock
from gcs.operator.web.connections import Connection, Connections
from gcs.operator.web.guard import HEADERS, Guard
from gcs.operator.web.limits import Guesses

_TOKEN_PATHS: Final = ("/video.mjpg", "/snapshot.jpg", "/status.json")  # for programs that keep no cookies
_OPEN: Final = web.AppKey("open", set[web.AbstractResource])
_LOST: Final = "Open the link that the station printed when it started: it ends in ?token=...\n"
_ANOTHER: Final = "This link is of another start of the station. "
_AGAIN: Final = '<!doctype html><meta http-equiv="refresh" content="0; url=/"><title>Station</title>'


log = logging.getLogger(__name__)


def make_open(app: web.Application, route: web.AbstractRoute) -> None:
    """Needs no token."""
    if _OPEN not in app:
        app[_OPEN] = set()
    if route.resource is not None:
        app[_OPEN].add(route.resource)


def middleware(guard: Guard, clock: Clock, connections: Connections) -> Middleware:
    """Everything passes here first."""
    guesses = Guesses()

    @web.middleware
    async def judged(request: web.Request, handler: Handler) -> web.StreamResponse:
        await asyncio.sleep(0)  # many requests sent at once take turns with all else
        host = request.headers.get("Host", "")
        own_address = request.transport.get_extra_info("sockname")[0] if request.transport is not None else ""
        if not guard.is_our_name(host, own_address):
            raise web.HTTPForbidden(text="Not under this name: use the address, or add it to page.names.\n")
        if request.match_info.route.resource in request.app.get(_OPEN, ()):
            return await _answer(request, handler)
        if not _is_known(request, guard, guesses, clock.now_s()):
            return _unknown(request)
        if isinstance(request.protocol, Connection):
            connections.shown(request.protocol)
        if request.method == "GET" and request.path == "/" and "token" in request.query:
            return _let_in(request, guard)
        changes = request.method not in ("GET", "HEAD") or request.path == "/ws"
        if changes and not guard.is_our_page(request.headers.get("Origin"), host):
            raise web.HTTPForbidden(text="Only from the station's own page.\n")
        return await _answer(request, handler)

    return judged


def _is_known(request: web.Request, guard: Guard, guesses: Guesses, now_s: float) -> bool:
    """By cookie or token. Too many wrong tokens shut out who has neither yet, never who has the cookie."""
    if guard.is_cookie(request.cookies.get(_cookie_name(request), "")):
        return True
    by_token = request.method in ("GET", "HEAD") and request.path in ("/", *_TOKEN_PATHS)
    token = request.query.get("token") if by_token else None
    if token is None:
        return False
    address = request.remote or ""
    wait_s = math.ceil(guesses.wait_s(address, now_s))
    if wait_s > 0:
        text = f"Too many wrong links from your address: wait {wait_s} s.\n"
        raise web.HTTPTooManyRequests(text=text, headers={"Retry-After": str(wait_s)})
    if guard.is_token(token):
        return True
    guesses.note(address, token, now_s)
    return False


def _let_in(request: web.Request, guard: Guard) -> web.StreamResponse:
    """The token becomes a cookie, so that it stands in no history and no address line."""
    response = web.Response(status=303, headers={"Location": "/"})
    response.set_cookie(_cookie_name(request), guard.cookie, httponly=True, samesite="Strict", path="/")
    return response


async def _answer(request: web.Request, handler: Handler) -> web.StreamResponse:
    try:
        return await handler(request)
    except (web.HTTPException, ConnectionError):
        raise
    except Exception:  # the edge of a request: a fault in one must not end the page
        log.exception("%s %s", request.method, request.path)
        raise web.HTTPInternalServerError(text="A fault of this program: see its log.\n") from None


def _unknown(request: web.Request) -> web.StreamResponse:
    if request.path == "/" and request.headers.get("Sec-Fetch-Site") == "cross-site":
        # A link in a mail or chat: a strict cookie is sent only with what our own page asks for.
        return web.Response(text=_AGAIN, content_type="text/html")
    raise web.HTTPUnauthorized(text=_ANOTHER + _LOST if "token" in request.query else _LOST)


def _cookie_name(request: web.Request) -> str:
    """Browsers share cookies between the ports of a host: two stations on one machine must not lock each other out."""
    return f"station_{request.url.port}"


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """On every answer, refusals too."""
    host = request.headers.get("Host", "")
    place = host if all(c.isalnum() or c in "-.:[]" for c in host) else ""
    for name, value in HEADERS.items():
        response.headers[name] = value.replace("{websocket}", f"ws://{place} wss://{place}" if place else "")
    response.headers["Server"] = "gcs"
    if isinstance(request.protocol, Connection) and not request.protocol.is_known:
        response.force_close()  # a stranger has one answer: what else it has sent costs nothing
        response.headers["Connection"] = "close"
