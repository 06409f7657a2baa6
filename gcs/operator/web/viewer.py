"""One browser at its WebSocket: what it is sent, as fast as it can take it, and what it may ask for."""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Final

from aiohttp import WSCloseCode, WSMsgType, web

from gcs.clock import Clock
from gcs.operator.web.limits import Flood, HoldToConfirm
from gcs.operator.web.protocol import MOST_BYTES, Asked, Candidates, Pictures, ProtocolError, Seen, decode
from gcs.operator.web.report_types import AnswerReport

if TYPE_CHECKING:
    from gcs.operator.web.pictures import Picture

_UNSEEN: Final = 2  # pictures on their way, or not yet shown
_LINES: Final = 200
_REASON_BYTES: Final = 120  # of a closing WebSocket
_CLOSE_S: Final = 1.0
_CODE: Final = struct.Struct("!H")

Handle = Callable[["Viewer", Asked], Awaitable[None]]


class Viewer:
    """Texts replace what is not yet sent of their kind, so that a slow browser gets the newest, never a queue."""

    wants_candidates = False

    def __init__(self, name: str, ws: web.WebSocketResponse, clock: Clock, deafen: Callable[[], None]) -> None:
        """deafen: ends that anything is read of it."""
        self.name = name
        self.hold = HoldToConfirm()
        self.pending = 0  # orders under way
        self._ws, self._clock, self._deafen = ws, clock, deafen
        self.heard_s = clock.now_s()
        self._flood = Flood(clock.now_s())
        self._texts: dict[str, bytes] = {}
        self._lines: deque[bytes] = deque(maxlen=_LINES)
        self._picture: Picture | None = None
        self._unseen: deque[int] = deque()
        self._sent_seq: int | None = None
        self._pictures_on = True
        self._work = asyncio.Event()

    # -- what it is sent: all of this returns at once ------------------------------------------------------

    @property
    def wants_picture(self) -> bool:
        """There is room on its way for another."""
        return self._pictures_on and len(self._unseen) < _UNSEEN

    def show(self, picture: Picture) -> None:
        """The newest picture, sent when there is room for it."""
        if picture.seq == self._sent_seq:
            return
        self._picture = picture
        if self.wants_picture:
            self._work.set()

    def put(self, kind: str, data: bytes) -> None:
        """A text of which only the newest counts."""
        self._texts[kind] = data
        self._work.set()

    def add(self, data: bytes) -> None:
        """A text of its own; of too many the oldest go."""
        self._lines.append(data)
        self._work.set()

    def forget(self) -> None:
        """The station has gone."""
        self._texts.clear()
        self._unseen.clear()
        self._picture = self._sent_seq = None
        self.hold.end()

    def answer(self, asked: Asked, ok: bool, text: str, reasons: tuple[str, ...] = ()) -> None:
        """To one message, if it asks for an answer or is refused."""
        if asked.id is not None or not ok:
            self.add(AnswerReport(id=asked.id, ok=ok, text=text, reasons=reasons).encode())

    async def _send(self) -> None:
        while True:
            await self._work.wait()
            self._work.clear()
            while self._lines:
                await self._ws.send_frame(self._lines.popleft(), WSMsgType.TEXT)
            for kind in tuple(self._texts):
                if (data := self._texts.pop(kind, None)) is not None:
                    await self._ws.send_frame(data, WSMsgType.TEXT)
            picture = self._picture
            if picture is not None and self.wants_picture:
                self._picture = None
                self._sent_seq = picture.seq
                self._unseen.append(picture.seq)
                await self._ws.send_frame(picture.message, WSMsgType.BINARY)

    # -- what it asks --------------------------------------------------------------------------------------

    async def run(self, handle: Handle) -> None:
        """Until it leaves, or has to."""
        sender = asyncio.create_task(self._sending())
        try:
            why = await self._receive(handle)
            if why is not None:
                await self._throw_out(*why)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sender

    async def close(self, code: int, reason: str) -> None:
        """From our side, with a reason for its user."""
        with contextlib.suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(_CLOSE_S):
                await self._ws.close(code=code, message=_reason(reason))

    async def _throw_out(self, code: int, reason: str) -> None:
        """Told why, but not waited for: whatever else it has sent by now is not even read."""
        self._deafen()
        with contextlib.suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(_CLOSE_S):
                await self._ws.send_frame(_CODE.pack(code) + _reason(reason), WSMsgType.CLOSE)

    async def _sending(self) -> None:
        with contextlib.suppress(ConnectionError):  # it has left: `run` hears of it too
            await self._send()

    async def _receive(self, handle: Handle) -> tuple[int, str] | None:
        """Its messages until it leaves; why it has to, where it does not by itself."""
        async for message in self._ws:
            now_s = self._clock.now_s()
            if self._flood.is_over(now_s):
                return WSCloseCode.POLICY_VIOLATION, "too many messages"
            if message.type is WSMsgType.PING:
                await self._ws.pong(message.data)
                continue
            if message.type is WSMsgType.PONG:
                continue
            if message.type is not WSMsgType.TEXT:
                return WSCloseCode.UNSUPPORTED_DATA, "only texts are understood"
            if len(message.data) > MOST_BYTES:
                return WSCloseCode.MESSAGE_TOO_BIG, f"more than {MOST_BYTES} bytes"
            self.heard_s = now_s
            try:
                asked = decode(message.data)
            except ProtocolError as error:
                return WSCloseCode.POLICY_VIOLATION, f"not understood: {error}"
            if not self._own(asked):
                await handle(self, asked)
                await asyncio.sleep(0)  # many messages that came at once take turns with all else
        return None

    def _own(self, asked: Asked) -> bool:
        """What concerns nobody else."""
        match asked:
            case Seen(frame=seq):
                while self._unseen and self._unseen[0] <= seq:
                    self._unseen.popleft()
                if self._picture is not None:
                    self._work.set()
                return True
            case Pictures(on=on):
                self._pictures_on = on
                self._unseen.clear()
            case Candidates(on=on):
                self.wants_candidates = on
            case _:
                return False
        self.answer(asked, True, "")
        return True


def _reason(text: str) -> bytes:
    """As much as a closing WebSocket can carry."""
    return text.encode()[:_REASON_BYTES].decode(errors="ignore").encode()
