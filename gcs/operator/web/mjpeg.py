"""The pictures as a plain stream (multipart JPEG), for who has no WebSocket: an <img>, VLC, OpenCV."""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, Final

from aiohttp import web

if TYPE_CHECKING:
    from gcs.operator.web.pictures import Picture

_BOUNDARY: Final = "picture"
_STUCK_S: Final = 10.0
_LOOK_S: Final = 1.0


class MjpegStream:
    """One who looks at it; a slow one misses pictures."""

    name = ""
    wants_candidates = False
    wants_picture = True

    def __init__(self) -> None:
        self._picture: Picture | None = None
        self._open = True
        self._work = asyncio.Event()

    def show(self, picture: Picture) -> None:
        """The newest is the next."""
        self._picture = picture
        self._work.set()

    def put(self, kind: str, data: bytes) -> None:
        """No texts here."""

    def add(self, data: bytes) -> None:
        """No texts here."""

    def forget(self) -> None:
        """The next station's pictures follow in the same stream."""
        self._picture = None

    async def close(self, code: int, reason: str) -> None:
        """The stream ends."""
        self._open = False
        self._work.set()

    async def run(self, request: web.Request) -> web.StreamResponse:
        """Until it leaves, or has taken nothing for ten seconds."""
        response = web.StreamResponse(headers={"Content-Type": f"multipart/x-mixed-replace; boundary={_BOUNDARY}"})
        await response.prepare(request)
        with contextlib.suppress(ConnectionError, TimeoutError):
            while self._open and request.transport is not None:
                with contextlib.suppress(TimeoutError):  # it may leave while no picture comes
                    async with asyncio.timeout(_LOOK_S):
                        await self._work.wait()
                self._work.clear()
                if (picture := self._picture) is not None:
                    self._picture = None
                    async with asyncio.timeout(_STUCK_S):
                        await response.write(_part(picture))
        if request.transport is not None:
            request.transport.abort()
        return response


def _part(picture: Picture) -> bytes:
    jpeg = picture.jpeg
    head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
    return b"".join((head.encode(), jpeg, b"\r\n"))
