"""Byte transports behind one URL form: udpin, udpout, tcpin, tcpout, serial.

None of them keeps what it cannot send now: a frame either goes to the operating system at once or `send`
says False. What waits in a buffer of ours would arrive late, and a late setpoint is a dangerous one.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeAlias
from urllib.parse import SplitResult, urlsplit

from gcs.errors import WireError

Peer: TypeAlias = tuple[str, int]
# Called on the event loop with the bytes and, for UDP, who sent them.
Received: TypeAlias = Callable[[bytes, Peer | None], None]

FORMS = "udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT or serial:///dev/NAME:BAUD"


class Kind(Enum):
    """How the bytes travel."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP_IN = "tcpin"
    TCP_OUT = "tcpout"
    SERIAL = "serial"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A parsed URL; host and port, or device and baud."""

    kind: Kind
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    @property
    def is_datagram(self) -> bool:
        """Each receipt is a whole datagram."""
        return self.kind in (Kind.UDP_IN, Kind.UDP_OUT)

    def __str__(self) -> str:
        if self.kind is Kind.SERIAL:
            return f"serial://{self.device}:{self.baud}"
        return f"{self.kind.value}://{self.host}:{self.port}"


class Transport(Protocol):
    """An open link of bytes."""

    @property
    def status(self) -> str:
        """In a few words for an error line: what the link is waiting for."""
        ...

    @property
    def connections(self) -> int:
        """How often the link has come up; a change means that a stream begins anew."""
        ...

    def send(self, data: bytes) -> bool:
        """Hand one frame to the operating system now; False if it would have to wait or there is nobody."""
        ...

    def reply_to(self, peer: Peer) -> None:
        """Send to this peer from now on; only udpin has a choice."""
        ...

    async def close(self) -> None:
        """Release the port or device."""
        ...


def parse_url(url: str) -> Endpoint:
    """The endpoint of a URL; WireError says what is wrong with it and what the forms are."""
    parts = urlsplit(url)
    try:
        kind = Kind(parts.scheme)
    except ValueError:
        raise WireError(f"vehicle address {url!r}: expected {FORMS}") from None
    return _serial(url) if kind is Kind.SERIAL else _network(kind, url, parts)


def _network(kind: Kind, url: str, parts: SplitResult) -> Endpoint:
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise WireError(f"vehicle address {url!r}: {error}") from None
    # Port 0 lets the system choose one, which only a listener can tell the other side.
    if not host or port is None or (port == 0 and kind in (Kind.UDP_OUT, Kind.TCP_OUT)):
        raise WireError(f"vehicle address {url!r}: needs a host and a port, as in {kind.value}://127.0.0.1:14540")
    if parts.path.strip("/") or parts.query or parts.fragment or parts.username:
        raise WireError(f"vehicle address {url!r}: nothing may follow the port")
    return Endpoint(kind, host=host, port=port)


def _serial(url: str) -> Endpoint:
    device, _, baud = url.removeprefix("serial://").rpartition(":")
    if not device or not baud.isdecimal() or int(baud) == 0:
        raise WireError(f"vehicle address {url!r}: needs a device and a baud rate, as in serial:///dev/ttyACM0:57600")
    return Endpoint(Kind.SERIAL, device=device, baud=int(baud))


def not_opened(endpoint: Endpoint, error: OSError) -> WireError:
    """Why a listener did not get its port, and for one in use how to see who has it."""
    reason = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
    if error.errno == errno.EADDRINUSE:
        protocol = "tcp" if endpoint.kind is Kind.TCP_IN else "udp"
        reason = f"{protocol.upper()} port {endpoint.port} is in use, perhaps by another ground station; "
        if sys.platform == "linux":
            reason += f"`ss -{protocol[0]}lpn sport = :{endpoint.port}` shows by whom"
        else:
            reason += f"`lsof -nP -i{protocol.upper()}:{endpoint.port}` shows by whom"
    return WireError(f"vehicle address {endpoint}: {reason}")


async def open_transport(endpoint: Endpoint, received: Received) -> Transport:
    """Open the link; WireError if the port is taken or the device is missing.

    tcpout keeps trying for a peer that does not answer yet, and tcpout and serial come back after a loss.
    """
    # Imported here because both modules take Endpoint and Received from this one.
    from gcs.transport_stream import SerialTransport, TcpInTransport, TcpOutTransport
    from gcs.transport_udp import UdpTransport

    match endpoint.kind:
        case Kind.UDP_IN | Kind.UDP_OUT:
            return await UdpTransport.open(endpoint, received)
        case Kind.TCP_IN:
            return await TcpInTransport.open(endpoint, received)
        case Kind.TCP_OUT:
            return TcpOutTransport(endpoint, received)
        case Kind.SERIAL:
            return SerialTransport(endpoint, received)
