"""RTSP 1.0 (RFC 2326) as the server of one live stream speaks it to one client: bytes in, bytes out, no I/O."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

TIMEOUT_S: Final = 60.0  # of a session, as told to the client
PATH: Final = "/live"
TRACK: Final = "track0"
_MOST_HEAD_BYTES: Final = 4096
_MOST_BODY_BYTES: Final = 4096
_MOST_MESSAGES_PER_S: Final = 50
_METHODS: Final = "OPTIONS, DESCRIBE, SETUP, PLAY, PAUSE, TEARDOWN, GET_PARAMETER, SET_PARAMETER"
_REASONS: Final = {
    200: "OK",
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    454: "Session Not Found",
    455: "Method Not Valid in This State",
    461: "Unsupported Transport",
    505: "RTSP Version Not Supported",
}
_REQUEST: Final = re.compile(r"([A-Z_]{1,20}) ([!-~]{1,512}) RTSP/(\d\.\d)")


class HostileError(Exception):
    """What was received is no RTSP, or too much of it: end the connection."""


@dataclass(frozen=True, slots=True)
class Interleaved:
    """RTP within the RTSP connection itself, on this channel."""

    channel: int


@dataclass(frozen=True, slots=True)
class Udp:
    """RTP to this port of the client, RTCP to the next one given."""

    rtp_port: int
    rtcp_port: int


@dataclass(frozen=True, slots=True)
class _Request:
    method: str
    url: str
    headers: dict[str, str]  # names in lower case


class RtspConnection:
    """One client. After each `receive`: what it wants (`transport`, `playing`), and whether it has `ended`."""

    def __init__(self, session: str, describe: Callable[[], str], udp_ports: tuple[int, int] | None, now_s: float):
        """session: an identifier nobody guesses; udp_ports: ours for RTP and RTCP, None where UDP is not offered."""
        self.transport: Interleaved | Udp | None = None
        self.playing = False
        self.ended = False
        self.heard_s = now_s
        self._session, self._describe, self._udp_ports = session, describe, udp_ports
        self._buffer = bytearray()
        self._skip_bytes = 0  # of a body or an interleaved packet, which nothing is done with
        self._times_s: deque[float] = deque(maxlen=_MOST_MESSAGES_PER_S)

    def receive(self, data: bytes, now_s: float) -> bytes:
        """What to answer to this. HostileError: end the connection."""
        self.heard_s = now_s
        self._buffer += data
        answers = b""
        while not self.ended and (head := self._next_head(now_s)) is not None:
            answers += self._answer(head)
        return answers

    def is_silent(self, now_s: float) -> bool:
        """Unheard for longer than a session may be."""
        return now_s - self.heard_s > TIMEOUT_S

    # -- reading ------------------------------------------------------------------------------------------

    def _next_head(self, now_s: float) -> str | None:
        """The next request's lines; None: not all of it is here."""
        while True:
            taken = min(self._skip_bytes, len(self._buffer))
            del self._buffer[:taken]
            self._skip_bytes -= taken
            if self._buffer.startswith((b"\r", b"\n")):
                self._buffer = self._buffer.lstrip(b"\r\n")
            if not self._buffer.startswith(b"$"):
                break
            if len(self._buffer) < 4:
                return None
            self._count(now_s)
            self._skip_bytes = 4 + int.from_bytes(self._buffer[2:4], "big")
        end = self._buffer.find(b"\r\n\r\n", 0, _MOST_HEAD_BYTES)
        if end < 0:
            if len(self._buffer) >= _MOST_HEAD_BYTES:
                raise HostileError("a request without end")
            return None
        head = self._buffer[:end].decode("ascii", "replace")
        del self._buffer[: end + 4]
        self._count(now_s)
        return head

    def _count(self, now_s: float) -> None:
        if len(self._times_s) == _MOST_MESSAGES_PER_S and now_s - self._times_s[0] < 1.0:
            raise HostileError("too many messages")
        self._times_s.append(now_s)

    def _answer(self, head: str) -> bytes:
        first, *lines = head.split("\r\n")
        headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        length = headers.get("content-length", "0")
        if not re.fullmatch(r"\d{1,6}", length) or int(length) > _MOST_BODY_BYTES:
            raise HostileError("a body that is too long")
        self._skip_bytes = int(length)
        sequence = headers.get("cseq", "")
        match = _REQUEST.fullmatch(first)
        if match is None or not re.fullmatch(r"\d{1,10}", sequence):
            self.ended = True
            return _reply(400, sequence if sequence.isdecimal() else "0")
        if match[3] != "1.0":
            return _reply(505, sequence)
        status, extra, body = self._perform(_Request(match[1], match[2], headers))
        return _reply(status, sequence, extra, body)

    # -- doing --------------------------------------------------------------------------------------------

    def _perform(self, request: _Request) -> tuple[int, tuple[str, ...], str]:
        if not self._is_ours(request):
            return 404, (), ""
        if request.headers.get("session", self._session).partition(";")[0] != self._session:
            return 454, (), ""
        match request.method:
            case "OPTIONS":
                return 200, (f"Public: {_METHODS}",), ""
            case "DESCRIBE":
                base = request.url.rstrip("/") + "/"
                return 200, ("Content-Type: application/sdp", f"Content-Base: {base}"), self._describe()
            case "SETUP":
                return self._set_up(request)
            case "PLAY" | "PAUSE" if self.transport is None:
                return 455, (), ""
            case "PLAY":
                self.playing = True
                return 200, (self._session_line, "Range: npt=now-"), ""
            case "PAUSE":
                self.playing = False
                return 200, (self._session_line,), ""
            case "GET_PARAMETER" | "SET_PARAMETER":
                return 200, (self._session_line,), ""
            case "TEARDOWN":
                self.playing, self.ended = False, True
                return 200, (), ""
            case _:
                return 405, (f"Allow: {_METHODS}",), ""

    @property
    def _session_line(self) -> str:
        return f"Session: {self._session};timeout={TIMEOUT_S:.0f}"

    def _is_ours(self, request: _Request) -> bool:
        if request.method == "OPTIONS" and request.url == "*":
            return True
        try:
            path = urlsplit(request.url).path.rstrip("/")
        except ValueError:
            return False
        return path in (PATH, f"{PATH}/{TRACK}")

    def _set_up(self, request: _Request) -> tuple[int, tuple[str, ...], str]:
        if self.playing:
            return 455, (), ""
        for offer in request.headers.get("transport", "").split(",")[:8]:
            if (found := self._transport(offer.strip())) is not None:
                self.transport, line = found
                return 200, (self._session_line, f"Transport: {line}"), ""
        return 461, (), ""

    def _transport(self, offer: str) -> tuple[Interleaved | Udp, str] | None:
        """What of it can be done; the client's own address is the only one anything is ever sent to."""
        kind, *rest = (part.strip() for part in offer.split(";"))
        if "multicast" in rest:
            return None
        values = dict(part.partition("=")[::2] for part in rest)
        if kind == "RTP/AVP/TCP":
            first, second = _pair(values.get("interleaved", "0-1"), most=255) or (0, 1)
            return Interleaved(first), f"RTP/AVP/TCP;unicast;interleaved={first}-{second}"
        ports = _pair(values.get("client_port", ""), most=65535)
        if kind not in ("RTP/AVP", "RTP/AVP/UDP") or self._udp_ports is None or ports is None or min(ports) < 1024:
            return None
        ours = f"server_port={self._udp_ports[0]}-{self._udp_ports[1]}"
        return Udp(*ports), f"RTP/AVP;unicast;client_port={ports[0]}-{ports[1]};{ours}"


def _pair(text: str, most: int) -> tuple[int, int] | None:
    """`6-7`, or `6` alone."""
    match = re.fullmatch(r"(\d{1,5})(?:-(\d{1,5}))?", text)
    if match is None:
        return None
    first = int(match[1])
    second = int(match[2]) if match[2] else first + 1
    return (first, second) if max(first, second) <= most else None


def _reply(status: int, sequence: str, extra: tuple[str, ...] = (), body: str = "") -> bytes:
    lines = [f"RTSP/1.0 {status} {_REASONS[status]}", f"CSeq: {sequence}", *extra]
    if body:
        lines.append(f"Content-Length: {len(body.encode())}")
    return ("\r\n".join(lines) + "\r\n\r\n" + body).encode()
