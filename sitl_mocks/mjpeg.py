"""Motion JPEG over HTTP for several viewers, on asyncio; a viewer that is slow misses frames, nobody waits for it.

GET /video answers multipart/x-mixed-replace, each part with its Content-Length; GET /frame.jpg the newest frame.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket

_BOUNDARY = "frame"
# Small enough that a stalled viewer holds a few frames at most, not seconds of them.
_SEND_BUFFER_BYTES = 64 * 1024
_REQUEST_TIMEOUT_S = 5.0
_REQUEST_MAX_LINES = 64


class MjpegServer:
    """`await start()`, then `publish(jpeg)` from the event loop for every frame, then `await close()`."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """port: 0 picks a free one."""
        self._host, self._port = host, port
        self._server: asyncio.Server | None = None
        self._newest: tuple[int, bytes] | None = None
        self._viewers: set[asyncio.Task[None]] = set()
        self._waiting: set[asyncio.Event] = set()

    @property
    def port(self) -> int:
        """The port it listens on, after start."""
        return self._port

    @property
    def url(self) -> str:
        """Where the video is, after start."""
        return f"http://{self._host}:{self._port}/video"

    @property
    def viewers(self) -> int:
        """How many connections are open."""
        return len(self._viewers)

    async def start(self) -> None:
        """Listen. Raises OSError when the port is taken."""
        self._server = await asyncio.start_server(self._serve, self._host, self._port)
        self._port = self._server.sockets[0].getsockname()[1]

    def publish(self, jpeg: bytes) -> None:
        """A new frame: it replaces the one before it, sent or not."""
        self._newest = (self._newest[0] + 1 if self._newest else 0, jpeg)
        for arrived in self._waiting:
            arrived.set()

    async def close(self) -> None:
        """Stop listening and end all viewers."""
        if self._server is not None:
            self._server.close()
        for task in self._viewers:
            task.cancel()
        await asyncio.gather(*self._viewers, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._viewers.add(task)
        try:
            # A viewer that goes away in the middle is the ordinary end of a stream.
            with contextlib.suppress(ConnectionError, TimeoutError, asyncio.CancelledError):
                await self._answer(await _read_path(reader), writer)
        finally:
            self._viewers.discard(task)
            writer.close()

    async def _answer(self, path: str | None, writer: asyncio.StreamWriter) -> None:
        match path:
            case "/video" | "/":
                await self._stream(writer)
            case "/frame.jpg":
                _, jpeg = await self._after(-1)
                writer.write(_head("200 OK", "image/jpeg", len(jpeg)) + jpeg)
            case None:
                writer.write(_head("400 Bad Request", "text/plain", 0))
            case _:
                writer.write(_head("404 Not Found", "text/plain", 0))
        await writer.drain()

    async def _stream(self, writer: asyncio.StreamWriter) -> None:
        _keep_buffers_small(writer)
        writer.write(_head("200 OK", f"multipart/x-mixed-replace; boundary={_BOUNDARY}", None))
        number = -1
        while True:
            number, jpeg = await self._after(number)
            # The boundary also closes the part: a reader that looks for it need not wait for the next frame.
            head = f"Content-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n".encode()
            writer.write(f"--{_BOUNDARY}\r\n".encode() + head + jpeg + b"\r\n")
            await writer.drain()

    async def _after(self, number: int) -> tuple[int, bytes]:
        """The newest frame, once it is newer than `number`."""
        arrived = asyncio.Event()
        self._waiting.add(arrived)
        try:
            while self._newest is None or self._newest[0] <= number:
                arrived.clear()
                await arrived.wait()
            return self._newest
        finally:
            self._waiting.discard(arrived)


async def _read_path(reader: asyncio.StreamReader) -> str | None:
    """The path of a GET request without its query, or None for anything else."""
    async with asyncio.timeout(_REQUEST_TIMEOUT_S):
        try:
            words = (await reader.readline()).decode("latin-1").split()
            for _ in range(_REQUEST_MAX_LINES):
                if (await reader.readline()).strip() == b"":
                    break
        except ValueError:  # a line longer than the reader's limit
            return None
    return words[1].split("?")[0] if len(words) == 3 and words[0] == "GET" else None


def _head(status: str, content_type: str, length: int | None) -> bytes:
    lines = [f"HTTP/1.1 {status}", f"Content-Type: {content_type}", "Cache-Control: no-store", "Connection: close"]
    if length is not None:
        lines.append(f"Content-Length: {length}")
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


def _keep_buffers_small(writer: asyncio.StreamWriter) -> None:
    writer.transport.set_write_buffer_limits(high=0)
    connection = writer.get_extra_info("socket")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
