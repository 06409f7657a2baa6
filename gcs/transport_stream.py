"""TCP and serial: byte streams that come back by themselves after a loss."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import logging
import os
import socket
import time
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from gcs.errors import WireError
from gcs.transport import Endpoint, Peer, Received, not_opened

_READ_BYTES = 4096
_SEND_BUFFER_BYTES = 2048  # of the kernel: a peer that takes nothing must not get old frames later
_STUCK_S = 1.0  # then a connection that takes nothing is given up, with what the system would still deliver late
_SERIAL_WAIT_S = 0.1  # what may wait in the driver before a new frame is refused
_CONNECT_S = 5.0
log = logging.getLogger(__name__)


def backoff_s() -> Iterator[float]:
    """Pauses between attempts: 0.25 s doubling up to 4 s, then 4 s for ever."""
    pause_s = 0.25
    while True:
        yield pause_s
        pause_s = min(2 * pause_s, 4.0)


class _Stream:
    """What both TCP directions share: at most one connection, its reader, sending without a queue."""

    def __init__(self, endpoint: Endpoint, received: Received) -> None:
        self._endpoint = endpoint
        self._received = received
        self._writer: asyncio.StreamWriter | None = None
        self._status = "not connected yet"
        self._connections = 0
        self._wrote_t_s = 0.0

    @property
    def status(self) -> str:
        """Connected, or why not."""
        return self._status

    @property
    def connections(self) -> int:
        """How often a connection has come up."""
        return self._connections

    def send(self, data: bytes) -> bool:
        """Write one frame, unless an earlier one is still waiting."""
        writer, now_s = self._writer, time.monotonic()
        if writer is None or writer.is_closing():
            return False
        if writer.transport.get_write_buffer_size() > 0:
            if now_s - self._wrote_t_s > _STUCK_S:
                self._status = "connection lost: the peer takes nothing"
                writer.transport.abort()
            return False
        self._wrote_t_s = now_s
        writer.write(data)
        return True

    def reply_to(self, peer: Peer) -> None:
        """A stream has one peer."""

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        sock = writer.get_extra_info("socket")
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(_STUCK_S * 1000))
        self._writer = writer
        self._connections += 1
        self._status = "connected"
        try:
            while data := await reader.read(_READ_BYTES):
                self._received(data, None)
            if not writer.transport.is_closing():
                self._status = "the peer closed the connection"
        except OSError as error:
            self._status = f"connection lost: {error.strerror or error}"
        finally:
            self._writer = None
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


class TcpOutTransport(_Stream):
    """Connects to a listening vehicle or router, again and again."""

    def __init__(self, endpoint: Endpoint, received: Received) -> None:
        super().__init__(endpoint, received)
        self._task = asyncio.get_running_loop().create_task(self._run(), name=f"{endpoint}")

    async def _run(self) -> None:
        pauses = backoff_s()
        while True:
            try:
                connect = asyncio.open_connection(self._endpoint.host, self._endpoint.port)
                reader, writer = await asyncio.wait_for(connect, _CONNECT_S)
            except (OSError, TimeoutError) as error:
                self._status = f"cannot connect: {getattr(error, 'strerror', None) or error or 'timed out'}"
            else:
                pauses = backoff_s()
                await self._serve(reader, writer)
            await asyncio.sleep(next(pauses))

    async def close(self) -> None:
        """End the connection and the attempts."""
        await _cancel(self._task)


class TcpInTransport(_Stream):
    """Listens; one client at a time, a second one is turned away."""

    def __init__(self, endpoint: Endpoint, received: Received) -> None:
        super().__init__(endpoint, received)
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[Any]] = set()
        self._status = "nobody has connected"

    @classmethod
    async def open(cls, endpoint: Endpoint, received: Received) -> TcpInTransport:
        """Listen; WireError if the port is taken."""
        transport = cls(endpoint, received)
        try:
            transport._server = await asyncio.start_server(transport._client, endpoint.host, endpoint.port)
        except OSError as error:
            raise not_opened(endpoint, error) from None
        return transport

    @property
    def port(self) -> int:
        """The local port."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._writer is not None:
            log.warning("%s: a second client was turned away", self._endpoint)
            writer.close()
            return
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        try:
            await self._serve(reader, writer)
        except asyncio.CancelledError:
            pass  # close() ends us; asyncio's server would log a cancelled client as an error
        finally:
            self._clients.discard(task)

    async def close(self) -> None:
        """Stop listening and end the client."""
        assert self._server is not None
        self._server.close()
        for task in tuple(self._clients):
            await _cancel(task)
        await self._server.wait_closed()


class SerialTransport:
    """A serial port by pyserial, opened exclusively, reopened after it was pulled. POSIX only."""

    def __init__(self, endpoint: Endpoint, received: Received) -> None:
        self._endpoint = endpoint
        self._received = received
        self._pyserial = _pyserial()
        self._loop = asyncio.get_running_loop()
        self._rest = b""  # of the one frame the device took only in part
        self._connections = 0
        self._reopen: asyncio.Task[None] | None = None
        try:
            self._port: Any = self._open()
        except OSError as error:
            raise WireError(f"vehicle address {endpoint}: {error.strerror or error}") from None
        self._status = "open"

    @property
    def status(self) -> str:
        """Open, or what went wrong."""
        return self._status

    @property
    def connections(self) -> int:
        """How often the device was opened."""
        return self._connections

    def _open(self) -> Any:
        # SerialException is an OSError. Exclusive: a second program on the port would eat half the bytes.
        port = self._pyserial.Serial(
            self._endpoint.device, self._endpoint.baud, timeout=0, write_timeout=0, exclusive=True
        )
        self._loop.add_reader(port.fileno(), self._readable)
        self._connections += 1
        return port

    def _readable(self) -> None:
        try:
            data = os.read(self._port.fileno(), _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lost(error.strerror or str(error))
            return
        if data:
            self._received(data, None)
        else:
            self._lost("the device is gone")

    def send(self, data: bytes) -> bool:
        """Write one frame, unless the one before is not out yet."""
        if self._port is None or self._rest or self._driver_is_full():
            return False
        self._rest = data
        self._write()
        return True

    def _driver_is_full(self) -> bool:
        try:
            waiting: int = self._port.out_waiting
        except OSError:  # not every driver can tell; a device that is gone shows when written to
            return False
        return waiting > self._endpoint.baud / 10 * _SERIAL_WAIT_S

    def _write(self) -> None:
        fd = self._port.fileno()
        try:
            self._rest = self._rest[os.write(fd, self._rest) :]
        except BlockingIOError:
            pass
        except OSError as error:
            self._lost(error.strerror or str(error))
            return
        if self._rest:
            self._loop.add_writer(fd, self._write)
        else:
            self._loop.remove_writer(fd)

    def _lost(self, reason: str) -> None:
        self._status = f"lost: {reason}"
        log.warning("%s %s", self._endpoint, self._status)
        self._release()
        self._reopen = self._loop.create_task(self._try_again(), name=f"{self._endpoint}")

    async def _try_again(self) -> None:
        for pause_s in backoff_s():
            await asyncio.sleep(pause_s)
            try:
                self._port = self._open()
            except OSError as error:
                self._status = f"lost: {error.strerror or error}"
            else:
                self._status = "open"
                return

    def _release(self) -> None:
        port, self._port, self._rest = self._port, None, b""
        if port is not None:
            self._loop.remove_reader(port.fileno())
            self._loop.remove_writer(port.fileno())
            port.close()

    def reply_to(self, peer: Peer) -> None:
        """A cable has one peer."""

    async def close(self) -> None:
        """Close the device."""
        if self._reopen is not None:
            await _cancel(self._reopen)
        self._release()


def _pyserial() -> ModuleType:
    try:
        return importlib.import_module("serial")
    except ImportError:
        raise WireError("a serial vehicle address needs pyserial: pip install 'climrt-gcs[serial]'") from None


async def _cancel(task: asyncio.Task[Any]) -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
