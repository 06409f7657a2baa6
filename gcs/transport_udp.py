"""UDP: one socket, nothing queued, the whole backlog read at once."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

from gcs.errors import WireError
from gcs.transport import Endpoint, Kind, Peer, Received, not_opened

_BACKLOG_DATAGRAMS = 2000  # read in one go; bounds how long a flood can hold the event loop
_MAX_DATAGRAM_BYTES = 65536


class UdpTransport(asyncio.DatagramProtocol):
    """udpin answers the peer it is told to, at first the one heard last; udpout has its peer from the URL."""

    def __init__(self, endpoint: Endpoint, received: Received, sock: socket.socket, peer: Peer | None) -> None:
        self._endpoint = endpoint
        self._received = received
        self._socket = sock
        self._peer = peer
        self._chosen = peer is not None
        self._transport: Any = None  # the stubs of asyncio.DatagramTransport lack get_write_buffer_size
        self._closed = asyncio.get_running_loop().create_future()
        self._heard = False
        self.last_error = ""

    @classmethod
    async def open(cls, endpoint: Endpoint, received: Received) -> UdpTransport:
        """Bind (udpin) or take any free port (udpout); WireError if the port is taken or the host unknown."""
        loop = asyncio.get_running_loop()
        try:
            infos = await loop.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise WireError(f"vehicle address {endpoint}: unknown host ({error.strerror})") from None
        family, _, _, _, address = infos[0]
        # Neither SO_REUSEADDR nor SO_REUSEPORT: with them two programs would share the packets silently.
        sock = socket.socket(family, socket.SOCK_DGRAM)
        sock.setblocking(False)
        peer = None
        try:
            if endpoint.kind is Kind.UDP_IN:
                sock.bind(address)
            else:
                peer = (str(address[0]), int(address[1]))
                sock.bind(("" if family == socket.AF_INET else "::", 0))
        except OSError as error:
            sock.close()
            raise not_opened(endpoint, error) from None
        transport = cls(endpoint, received, sock, peer)
        await loop.create_datagram_endpoint(lambda: transport, sock=sock)
        return transport

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    @property
    def status(self) -> str:
        """What has been heard."""
        if self.last_error:
            return self.last_error
        return "bytes have been heard" if self._heard else "nobody has sent anything"

    @property
    def connections(self) -> int:
        """Always one: datagrams know no connection."""
        return 1

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the socket is registered."""
        self._transport = transport

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the socket is closed."""
        if not self._closed.done():
            self._closed.set_result(None)

    def error_received(self, exc: Exception) -> None:
        """asyncio: the system reports a failed send, such as no route to the peer."""
        self.last_error = getattr(exc, "strerror", None) or str(exc)

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        """asyncio hands over one datagram per turn of the loop; the rest of the backlog is taken here.

        After a stall everything that waited is so known before any timer of ours acts on an old state.
        """
        self._take(data, addr)
        for _ in range(_BACKLOG_DATAGRAMS):
            try:
                data, addr = self._socket.recvfrom(_MAX_DATAGRAM_BYTES)
            except OSError:  # BlockingIOError: empty; others come again by way of asyncio
                return
            self._take(data, addr)

    def _take(self, data: bytes, addr: tuple[Any, ...]) -> None:
        peer = (str(addr[0]), int(addr[1]))
        if not self._chosen:
            self._peer = peer
        self._heard, self.last_error = True, ""
        self._received(data, peer)

    def send(self, data: bytes) -> bool:
        """One datagram, if the system takes it now."""
        if self._transport is None or self._transport.is_closing() or self._peer is None:
            return False
        if self._transport.get_write_buffer_size() > 0:
            return False
        self._transport.sendto(data, self._peer)
        return True

    def reply_to(self, peer: Peer) -> None:
        """udpin: send to this peer from now on, whoever else may send to us."""
        if self._endpoint.kind is Kind.UDP_IN:
            self._peer, self._chosen = peer, True

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
            await self._closed
