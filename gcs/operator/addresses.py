"""The addresses that we serve at: as a socket, and as others know them."""

from __future__ import annotations

import ipaddress
import socket

_RECEIVE_BYTES, _SEND_BYTES = 32 * 1024, 256 * 1024


def bound_socket(host: str, port: int) -> socket.socket:
    """Raises OSError where it is taken or not ours.

    Small buffers: no client can make us parse much at once, and what a slow one sees is not long past.
    """
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    listening = socket.socket(family, kind, protocol)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BYTES)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
        listening.bind(address)
        listening.setblocking(False)
    except OSError:
        listening.close()
        raise
    return listening


def reachable_url(scheme: str, host: str, port: int, path: str) -> str:
    """As others reach what listens there: where that is on all our addresses, by the one they most likely know."""
    host = _reachable(host)
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}{path}"


def _reachable(host: str) -> str:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if not address.is_unspecified:
        return host
    family, far = (socket.AF_INET, "192.0.2.1") if address.version == 4 else (socket.AF_INET6, "2001:db8::1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))  # sends nothing: it asks which way would be taken
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1" if address.version == 4 else "::1"
