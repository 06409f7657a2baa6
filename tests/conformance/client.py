"""A small ground station on one UDP socket: sends, remembers everything that comes, waits for what it expects."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from pymavlink.dialects.v20 import common as mavlink

NAN = math.nan
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
RESULTS = ("ACCEPTED", "TEMPORARILY_REJECTED", "DENIED", "UNSUPPORTED", "FAILED", "IN_PROGRESS")
TIMEOUT_S = 3.0


class Client(asyncio.DatagramProtocol):
    """udpin://HOST:PORT waits for a camera that speaks first, udpout://HOST:PORT speaks to one."""

    def __init__(self, system_id: int = 255, component_id: int = 190) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self.mav.robust_parsing = True
        self.heard: list[Any] = []
        self.system_id, self.component_id = system_id, component_id
        self.camera: tuple[int, int] | None = None  # system and component, once its heartbeat was heard
        self._to: tuple[Any, ...] | None = None
        self._more = asyncio.Event()
        self._socket: Any = None

    @classmethod
    async def open(cls, url: str, system_id: int = 255, component_id: int = 190) -> Client:
        parts = urlsplit(url)
        assert parts.scheme in ("udpin", "udpout"), f"{url}: udpin://HOST:PORT or udpout://HOST:PORT"
        client = cls(system_id, component_id)
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setblocking(False)
        if parts.scheme == "udpin":
            sock.bind((parts.hostname, parts.port))
        else:
            sock.bind(("0.0.0.0", 0))
            client._to = (socket.gethostbyname(parts.hostname or ""), parts.port)
        await asyncio.get_running_loop().create_datagram_endpoint(lambda: client, sock=sock)
        return client

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._socket = transport

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        self._to = self._to or addr
        for message in self.mav.parse_buffer(data) or []:
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
                continue
            self.heard.append(message)
        self._more.set()

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet."""

    def send(self, message: Any) -> None:
        if self._to is None:
            return
        self._socket.sendto(message.pack(self.mav), self._to)
        self.mav.seq = (self.mav.seq + 1) % 256

    def send_bytes(self, data: bytes) -> None:
        self._socket.sendto(data, self._to)

    def heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    async def keep_alive(self) -> None:
        while True:
            self.heartbeat()
            await asyncio.sleep(0.5)

    async def wait(
        self,
        kind: str,
        fits: Callable[[Any], bool] = lambda message: True,
        since: int = 0,
        timeout_s: float = TIMEOUT_S,
    ) -> Any:
        """The first message of this kind after the `since`th; AssertionError if none comes."""
        at = since
        try:
            async with asyncio.timeout(timeout_s):
                while True:
                    for message in self.heard[at:]:
                        at += 1
                        if message.get_type() == kind and fits(message):
                            return message
                    self._more.clear()
                    await self._more.wait()
        except TimeoutError:
            raise AssertionError(f"no {kind} came within {timeout_s:g} s") from None

    async def find_camera(self, timeout_s: float = 10.0) -> tuple[int, int]:
        """System and component of the first camera heard."""
        speaking = asyncio.get_running_loop().create_task(self.keep_alive())
        try:
            found = await self.wait("HEARTBEAT", is_camera, timeout_s=timeout_s)
        finally:
            speaking.cancel()
        self.camera = found.get_srcSystem(), found.get_srcComponent()
        return self.camera

    def long(self, number: int, *params: float, confirmation: int = 0, to: tuple[int, int] | None = None) -> Any:
        """COMMAND_LONG; parameters that are not given are 0."""
        target = to or self.camera
        assert target is not None
        seven = [*params, *[0.0] * (7 - len(params))]
        return mavlink.MAVLink_command_long_message(*target, number, confirmation, *seven)

    async def command(self, number: int, *params: float, **how: Any) -> int:
        """Its result."""
        since = len(self.heard)
        self.send(self.long(number, *params, **how))
        return await self.acknowledged(number, since)

    async def acknowledged(self, number: int, since: int) -> int:
        def is_for_us(ack: Any) -> bool:
            return ack.command == number and ack.target_system in (0, self.system_id) and ack.result != 5

        return int((await self.wait("COMMAND_ACK", is_for_us, since)).result)

    async def request(self, message_id: int, kind: str, *params: float) -> Any:
        """A message by MAV_CMD_REQUEST_MESSAGE; checks that the acknowledgement came before it."""
        return await self.asked(512, kind, float(message_id), *params)

    async def asked(self, number: int, kind: str, *params: float) -> Any:
        """A message by this command; checks that the acknowledgement came before it."""
        since = len(self.heard)
        result = await self.command(number, *params)
        assert result == ACCEPTED, f"command {number} for {kind}: {RESULTS[result]}"
        message = await self.wait(kind, since=since)
        kinds = [each.get_type() for each in self.heard[since:]]
        assert kinds.index("COMMAND_ACK") < kinds.index(kind), f"{kind} came before its COMMAND_ACK"
        return message

    async def tracking(self, fits: Callable[[Any], bool], timeout_s: float = TIMEOUT_S) -> Any:
        """The next CAMERA_TRACKING_IMAGE_STATUS that fits; the interval must have been set."""
        return await self.wait("CAMERA_TRACKING_IMAGE_STATUS", fits, len(self.heard), timeout_s)

    def close(self) -> None:
        self._socket.close()


def value_bytes(message: Any) -> bytes:
    """All of param_value: pymavlink takes it for text and drops the zeros at its end."""
    return bytes(message._param_value_raw).ljust(128, b"\0")


def is_camera(message: Any) -> bool:
    """As QGroundControl tells: the type with no autopilot, or one of the six component ids."""
    if message.get_type() != "HEARTBEAT":
        return False
    return (message.type == 30 and message.autopilot == 8) or 100 <= message.get_srcComponent() <= 105
