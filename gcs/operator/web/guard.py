"""Who may speak to the page: the token's owner, under our own name, from our own page."""

from __future__ import annotations

import functools
import hashlib
import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from urllib.parse import urlsplit

HEADERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Content-Security-Policy": (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
            "media-src 'self' blob:; connect-src 'self' {websocket}; manifest-src 'self'; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        ),
        "X-Frame-Options": "DENY",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
    }
)


class Guard:
    """Judges what a request carries; holds the token and the cookie that is given for it.

    The cookie is made from the token, so that a token of the configuration lets a browser in after a restart too.
    """

    def __init__(self, token: str | None, names: tuple[str, ...]) -> None:
        self.token = token or secrets.token_urlsafe(18)
        self.cookie = _cookie_of(self.token)
        self._names = frozenset(name.lower().rstrip(".") for name in ("localhost", *names))

    def is_token(self, given: str) -> bool:
        """In constant time."""
        return hmac.compare_digest(given.encode(errors="replace"), self.token.encode())

    def is_cookie(self, given: str) -> bool:
        """In constant time."""
        return hmac.compare_digest(given.encode(errors="replace"), self.cookie.encode())

    def is_our_name(self, host: str, own_address: str) -> bool:
        """Of a Host header: else a foreign page whose name is made to point here could read ours (DNS rebinding)."""
        name = _name_of(host)
        if name is None:
            return False
        if name.rstrip(".") in self._names:
            return True
        try:
            address, own = _address(name), _address(own_address)
        except ValueError:
            return False
        return address.is_loopback or address == own

    def is_our_page(self, origin: str | None, host: str) -> bool:
        """Of an Origin header: a browser's program from elsewhere must not speak here in its user's name."""
        if origin is None:
            return False
        scheme, separator, place = origin.partition("://")
        return bool(separator) and scheme in ("http", "https") and place.lower() == host.lower()


@functools.cache  # it is meant to be slow: who guesses tokens could otherwise try their cookies by the million
def _cookie_of(token: str) -> str:
    return hashlib.scrypt(token.encode(), salt=b"the operator's page", n=2**14, r=8, p=1, dklen=32).hex()


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    address = ipaddress.ip_address(text.partition("%")[0])
    return getattr(address, "ipv4_mapped", None) or address  # as a socket for both calls the older kind


def _name_of(host: str) -> str | None:
    """Without the port; None where it is none."""
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port  # checks it
    except ValueError:
        return None
    if parts.username is not None or parts.path or parts.query or parts.fragment:
        return None
    return parts.hostname
