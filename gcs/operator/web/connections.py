"""Every connection to the page: how many there may be, and what one may cost before it has shown who it is.

Nobody is refused by a number, for then a stranger could keep the operator out: it is the ones that wait longest who
have to leave, and first those of the address that has the most.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from typing import Any, Final

from aiohttp import web

MOST_STRANGE: Final = 64  # that have shown neither token nor cookie
MOST_STRANGE_OF_ONE: Final = 32  # of one address; a browser opens six at once
MOST_SPARE: Final = 64  # that are known and do not look at the video
_AT_ONCE: Final = 8  # taken up in one turn of the loop, each costs some 0.3 ms
_WAITING: Final = 64  # in the system
_READ_BYTES: Final = 2048  # parsed in one turn: the smallest frames of a WebSocket cost 0.5 ms then
_IDLE_S: Final = 10.0  # for a whole request's head, or between two requests
_LINGER_S: Final = 1.0  # for the rest of a body that nobody wants

# What strangers send is no fault of ours; faults of ours are caught and logged by the page.
_SILENT: Final = logging.getLogger(f"{__name__}.http")
_SILENT.setLevel(logging.CRITICAL + 1)


class Connection(web.RequestHandler):
    """One of them."""

    def __init__(self, owner: Connections, server: web.Server, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(
            server, loop=loop, keepalive_timeout=_IDLE_S, lingering_time=_LINGER_S, auto_decompress=False,
            logger=_SILENT,
        )  # fmt: skip
        self._owner = owner
        self.address = ""
        self.is_known = self.is_looking = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: somebody has connected."""
        self.address = str((transport.get_extra_info("peername") or ("",))[0])
        transport.max_size = _READ_BYTES  # type: ignore[attr-defined]  # of asyncio's own; others leave it alone
        super().connection_made(transport)
        self._owner.came(self)

    def connection_lost(self, exc: BaseException | None) -> None:
        """asyncio: it has ended."""
        self._owner.left(self)
        super().connection_lost(exc)


class Connections:
    """Those that are open, the one unheard for longest first."""

    def __init__(self) -> None:
        self._open: dict[Connection, None] = {}
        self._server: asyncio.Server | None = None

    def __len__(self) -> int:
        return len(self._open)

    async def listen(self, server: web.Server, listening: Any) -> None:
        """Take connections from this socket."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: Connection(self, server, loop), sock=listening, backlog=_AT_ONCE
        )
        listening.listen(_WAITING)

    def close(self) -> None:
        """No more new ones."""
        if self._server is not None:
            self._server.close()

    def came(self, connection: Connection) -> None:
        """It is new, and a stranger's; somebody may have to leave for it."""
        self._open[connection] = None
        strange = Counter(each.address for each in self._open if not each.is_known)
        crowded = None
        if strange[connection.address] > MOST_STRANGE_OF_ONE:
            crowded = connection.address
        elif strange.total() > MOST_STRANGE:
            crowded = max(strange, key=lambda address: strange[address])
        if crowded is not None:
            self._drop(next(each for each in self._open if not each.is_known and each.address == crowded))

    def left(self, connection: Connection) -> None:
        """It is no more."""
        self._open.pop(connection, None)

    def shown(self, connection: Connection) -> None:
        """It has shown token or cookie."""
        connection.is_known = True
        if self._open.pop(connection, self) is None:  # still open: it has been heard last
            self._open[connection] = None
        spare = [each for each in self._open if each.is_known and not each.is_looking]
        if len(spare) > MOST_SPARE:
            self._drop(spare[0])

    def _drop(self, connection: Connection) -> None:
        self.left(connection)
        if connection.transport is not None:
            connection.transport.abort()
