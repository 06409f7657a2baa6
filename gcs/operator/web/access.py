"""Lets in who may come: name, token or cookie, origin; and the headers that keep a browser careful."""

from __future__ import annotations

from typing import Final

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from gcs.operator.web.guard import HEADERS, Guard

_TOKEN_PATHS: Final = ("/video.mjpg", "/snapshot.jpg", "/status.json")  # for programs that keep no cookies
_OPEN: Final = web.AppKey("open", set[web.AbstractResource])
_LOST: Final = "Open the link that the station printed when it started: it ends in ?token=...\n"
_AGAIN: Final = '<!doctype html><meta http-equiv="refresh" content="0; url=/"><title>Station</title>'


def make_open(app: web.Application, route: web.AbstractRoute) -> None:
    """Needs no token."""
    if _OPEN not in app:
        app[_OPEN] = set()
    if route.resource is not None:
        app[_OPEN].add(route.resource)


def middleware(guard: Guard) -> Middleware:
    """Everything passes here first."""

    @web.middleware
    async def judged(request: web.Request, handler: Handler) -> web.StreamResponse:
        host = request.headers.get("Host", "")
        own_address = request.transport.get_extra_info("sockname")[0] if request.transport is not None else ""
        if not guard.is_our_name(host, own_address):
            raise web.HTTPForbidden(text="Not under this name: use the address, or add it to page.names.\n")
        if request.match_info.route.resource in request.app.get(_OPEN, ()):
            return await handler(request)
        if request.path == "/" and "token" in request.query:
            return _let_in(request, guard)
        if not _is_known(request, guard):
            return _unknown(request)
        changes = request.method not in ("GET", "HEAD") or request.path == "/ws"
        if changes and not guard.is_our_page(request.headers.get("Origin"), host):
            raise web.HTTPForbidden(text="Only from the station's own page.\n")
        return await handler(request)

    return judged


def _is_known(request: web.Request, guard: Guard) -> bool:
    if guard.is_cookie(request.cookies.get(_cookie_name(request), "")):
        return True
    by_token = request.method in ("GET", "HEAD") and request.path in _TOKEN_PATHS
    return by_token and guard.is_token(request.query.get("token", ""))


def _let_in(request: web.Request, guard: Guard) -> web.StreamResponse:
    """The token becomes a cookie, so that it stands in no history and no address line."""
    if request.method != "GET" or not guard.is_token(request.query["token"]):
        raise web.HTTPUnauthorized(text="This link is of another start of the station. " + _LOST)
    response = web.Response(status=303, headers={"Location": "/"})
    response.set_cookie(_cookie_name(request), guard.cookie, httponly=True, samesite="Strict", path="/")
    return response


def _unknown(request: web.Request) -> web.StreamResponse:
    if request.path == "/" and request.headers.get("Sec-Fetch-Site") == "cross-site":
        # A link in a mail or chat: a strict cookie is sent only with what our own page asks for.
        return web.Response(text=_AGAIN, content_type="text/html")
    raise web.HTTPUnauthorized(text=_LOST)


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
