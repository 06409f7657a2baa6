"""The sockets of the RTSP server: several clients, none of whom can hold up the loop or another one."""

from __future__ import annotations

import asyncio
import itertools
import secrets
import socket
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final

from gcs.errors import WireError
from gcs.video_out.rtsp import HostileError, Interleaved, RtspConnection, Udp

_MOST_CLIENTS: Final = 8
_AT_ONCE: Final = 8  # connections taken up in one turn of the loop
_SET_UP_S: Final = 15.0  # a client that plays nothing by then is sent away
_SWEEP_S: Final = 1.0
_SYSTEM_BUFFER_BYTES: Final = 128 * 1024  # in the system: less than half a second at the usual bit rate
_MOST_WAITING_BYTES: Final = 256 * 1024  # with us: more than that, and pictures are left out
_STUCK_S: Final = 8.0
_PORT_TRIES: Final = 50


class RtspServer:
    """Serves one stream; changed: told whenever somebody begins or ends to take it."""

    def __init__(
        self, describe: Callable[[], str], changed: Callable[[], None], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.describe, self.now_s = describe, now_s
        self._changed = changed
        self._clients: dict[_Client, None] = {}  # in the order in which they came
        self._listener: asyncio.Server | None = None
        self._udp: _UdpPair | None = None
        self._sweeper: asyncio.Task[None] | None = None

    async def open(self, host: str, port: int) -> None:
        """Listen; WireError where the port is taken or the host is none of this machine."""
        loop = asyncio.get_running_loop()
        try:
            self._listener = await loop.create_server(lambda: _Client(self), host, port, backlog=_AT_ONCE)
        except OSError as error:
            raise WireError(f"RTSP at {host}:{port}: {(error.strerror or str(error)).lower()}") from None
        self._udp = await _UdpPair.open(host, self._heard)
        self._sweeper = asyncio.create_task(self._sweep(), name="rtsp clients")

    @property
    def port(self) -> int:
        """The port it listens at."""
        return int(self._listener.sockets[0].getsockname()[1]) if self._listener is not None else 0

    @property
    def players(self) -> int:
        """How many take the stream now."""
        return sum(client.rtsp.playing for client in self._clients)

    @property
    def heard_s(self) -> float:
        """When a client was heard last; 0: none is there."""
        return max((client.rtsp.heard_s for client in self._clients), default=0.0)

    @property
    def udp_ports(self) -> tuple[int, int] | None:
        """Where RTP and RTCP of UDP clients come from; None: no two free ports were found."""
        return self._udp.ports if self._udp is not None else None

    def send(self, packets: Sequence[bytes], is_key: bool) -> None:
        """One picture to everybody who takes it."""
        now_s = self.now_s()
        for client in tuple(self._clients):
            client.send(packets, is_key, now_s, self._udp)

    def sweep(self) -> None:
        """Send away who is silent, stuck, or never asked for anything; done by itself each second."""
        for client in tuple(self._clients):
            client.check(self.now_s())

    async def close(self) -> None:
        """Send everybody away."""
        if self._sweeper is not None:
            self._sweeper.cancel()
        if self._listener is not None:
            self._listener.close()
        for client in tuple(self._clients):
            client.drop()
        if self._udp is not None:
            self._udp.close()

    # -- of its clients -----------------------------------------------------------------------------------

    def joined(self, client: _Client) -> bool:
        """False: there is no room for it. Who plays nothing makes room, and then a host that has far more than it."""
        if len(self._clients) >= _MOST_CLIENTS:
            counts = Counter(each.host for each in self._clients)
            idle = (each for each in self._clients if not each.rtsp.playing)
            crowd = (each for each in self._clients if counts[each.host] > counts[client.host] + 1)
            leaves = next(itertools.chain(idle, crowd), None)
            if leaves is None:
                return False
            del self._clients[leaves]
            leaves.drop()
        self._clients[client] = None
        return True

    def left(self, client: _Client) -> None:
        """Its connection has ended."""
        self._clients.pop(client, None)
        self._changed()

    def changed(self) -> None:
        """Somebody begins or ends to play."""
        self._changed()

    def _heard(self, address: tuple[str, int]) -> None:
        for client in self._clients:
            if client.udp_address == address:
                client.rtsp.heard_s = self.now_s()

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(_SWEEP_S)
            self.sweep()


class _Client(asyncio.Protocol):
    """One connection; a slow one loses pictures, and then itself."""

    rtsp: RtspConnection

    def __init__(self, server: RtspServer) -> None:
        self._server = server
        self._transport: Any = None
        self.host = ""
        self._wants_key = True
        self._since_s = 0.0
        self._stuck_since_s: float | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: somebody has connected."""
        self._transport, self._since_s = transport, self._server.now_s()
        self.host = str(transport.get_extra_info("peername")[0])
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SYSTEM_BUFFER_BYTES)
        session = secrets.token_hex(8)
        self.rtsp = RtspConnection(session, self._server.describe, self._server.udp_ports, self._since_s)
        if not self._server.joined(self):
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: it has ended."""
        self.rtsp.playing = False
        self._server.left(self)

    def data_received(self, data: bytes) -> None:
        """asyncio: the client has said something."""
        was_playing = self.rtsp.playing
        try:
            answer = self.rtsp.receive(data, self._server.now_s())
        except HostileError:
            self.drop()
            return
        self._transport.write(answer)
        if self.rtsp.playing != was_playing:
            self._wants_key = True
            self._server.changed()
        if self.rtsp.ended:
            self._transport.close()
        elif self._transport.get_write_buffer_size() > 2 * _MOST_WAITING_BYTES:
            self.drop()

    def drop(self) -> None:
        """End it now, whatever is still to be sent."""
        self._transport.abort()

    def check(self, now_s: float) -> None:
        """End it, where nobody is there any more."""
        idle = not self.rtsp.playing and now_s - max(self._since_s, self.rtsp.heard_s) > _SET_UP_S
        gone = isinstance(self.rtsp.transport, Udp) and self.rtsp.is_silent(now_s)
        if idle or gone or (self._stuck_since_s is not None and now_s - self._stuck_since_s > _STUCK_S):
            self.drop()

    @property
    def udp_address(self) -> tuple[str, int] | None:
        """Where its RTCP comes from, where it takes UDP."""
        udp = self.rtsp.transport
        return (self.host, udp.rtcp_port) if isinstance(udp, Udp) else None

    def send(self, packets: Sequence[bytes], is_key: bool, now_s: float, udp: _UdpPair | None) -> None:
        """One picture, if it can be understood and taken now."""
        if not self.rtsp.playing or (self._wants_key and not is_key):
            return
        match self.rtsp.transport:
            case Interleaved(channel):
                sent = self._send_interleaved(packets, channel, now_s)
            case Udp(rtp_port, _) if udp is not None:
                sent = udp.send(packets, (self.host, rtp_port))
            case _:
                return
        self._wants_key = not sent

    def _send_interleaved(self, packets: Sequence[bytes], channel: int, now_s: float) -> bool:
        if self._transport.get_write_buffer_size() > _MOST_WAITING_BYTES:
            self._stuck_since_s = self._stuck_since_s or now_s
            return False
        self._stuck_since_s = None
        head = b"$" + bytes([channel])
        self._transport.write(b"".join(head + len(packet).to_bytes(2, "big") + packet for packet in packets))
        return True


class _UdpPair:
    """The server's own two ports, one for RTP and the next for RTCP, for all its clients."""

    def __init__(self, rtp: Any, rtcp: Any) -> None:
        self._rtp, self._rtcp = rtp, rtcp
        self.ports: tuple[int, int] = (rtp.get_extra_info("sockname")[1], rtcp.get_extra_info("sockname")[1])

    @classmethod
    async def open(cls, host: str, heard: Callable[[tuple[str, int]], None]) -> _UdpPair | None:
        loop = asyncio.get_running_loop()
        for _ in range(_PORT_TRIES):
            rtp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=(host, 0))
            port = rtp.get_extra_info("sockname")[1]
            try:
                if port % 2 == 0:  # RTP's is even (RFC 3550)
                    rtcp, _ = await loop.create_datagram_endpoint(lambda: _Rtcp(heard), local_addr=(host, port + 1))
                    return cls(rtp, rtcp)
            except OSError:
                pass
            rtp.close()
        return None

    def send(self, packets: Sequence[bytes], address: tuple[str, int]) -> bool:
        """False: the system would have to wait."""
        for packet in packets:
            if self._rtp.get_write_buffer_size() > 0:
                return False
            self._rtp.sendto(packet, address)
        return True

    def close(self) -> None:
        self._rtp.close()
        self._rtcp.close()


class _Rtcp(asyncio.DatagramProtocol):
    """Receivers' reports are read for one thing: the receiver is still there."""

    def __init__(self, heard: Callable[[tuple[str, int]], None]) -> None:
        self._heard = heard

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        self._heard((str(addr[0]), int(addr[1])))
