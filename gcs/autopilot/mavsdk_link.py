"""One MAVSDK instance whose every byte goes through our wire, and which is shut down in order.

Measured with mavsdk 4.1.0: a call after destroy() crashes the interpreter, and destroy() during a call hangs
it; its asyncio calls share the default executor. Hence: own threads, one owner, one way to end.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, TypeVar

import mavsdk

from gcs import codec
from gcs.clock import Clock
from gcs.errors import VehicleError
from gcs.framing import Message, dialect
from gcs.wire import Wire

T = TypeVar("T")
_THREADS = 4  # so that hold never queues behind a parameter that nobody answers
_OUTGOING_FRAMES = 256
_CLOSED = "the connection to the vehicle is closed"
_PENDING_S = 15.0  # the longest MAVSDK call gives up after 12 s
log = logging.getLogger(__name__)

# Where it is and how it lies, many times a second: actions and parameters need none of it.
_NOT_FOR_IT: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE,
        dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
    }
)


class MavsdkLink:
    """MAVSDK attached by raw:// to a Wire whose vehicle is pinned; use on the wire's event loop."""

    def __init__(self, wire: Wire, clock: Clock) -> None:
        self._wire = wire
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._executor = ThreadPoolExecutor(_THREADS, thread_name_prefix="mavsdk")
        self._pending: dict[asyncio.Future[Any], Future[Any]] = {}
        self._outgoing: deque[tuple[bytes, float]] = deque(maxlen=_OUTGOING_FRAMES)
        self._outgoing_lock = threading.Lock()
        self._closed = False
        mavsdk.log_subscribe(lambda *_: True)  # it would print to standard output
        configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        self._mavsdk: Any = mavsdk.Mavsdk(configuration)
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._made)
        result = self._mavsdk.add_any_connection("raw://")
        if result != mavsdk.ConnectionResult.SUCCESS:
            self._mavsdk.destroy()
            self._executor.shutdown(wait=False)
            raise VehicleError(f"MAVSDK does not start: {result.name}")
        self._unsubscribe = wire.subscribe(self._feed)

    def _made(self, data: bytes) -> None:
        """On a thread of MAVSDK: a frame to send. The time is that of making, so a stalled loop makes it stale."""
        with self._outgoing_lock:
            wake = not self._outgoing
            self._outgoing.append((data, self._clock.now_s()))
        if wake and not self._closed:
            try:
                self._loop.call_soon_threadsafe(self._send)
            except RuntimeError:  # the loop ended without close(): nobody is left to send to
                self._closed = True

    def _send(self) -> None:
        with self._outgoing_lock:
            frames = tuple(self._outgoing)
            self._outgoing.clear()
        for data, t_made_s in frames:
            self._wire.send_raw(data, t_made_s)

    def _feed(self, message: Message, _t_s: float) -> None:
        vehicle = self._wire.vehicle
        # Of the autopilot alone: MAVSDK would take a COMMAND_ACK or PARAM_VALUE from any component of the system.
        if self._closed or vehicle is None or message.get_msgId() in _NOT_FOR_IT:
            return
        if codec.is_from(message, vehicle):
            self._mavsdk.pass_received_raw_bytes(bytes(message.get_msgbuf()))

    async def system(self, timeout_s: float) -> Any:
        """The mavsdk.System of the vehicle; VehicleError if MAVSDK does not see it in time."""
        self._refuse_closed()
        system = await self.call(self._mavsdk.first_autopilot, timeout_s)
        if system is None:
            raise VehicleError(f"MAVSDK found no autopilot at {self._wire.url} within {timeout_s:g} s")
        return system

    async def call(self, function: Callable[..., T], *args: Any) -> T:
        """Run a blocking MAVSDK call on our own threads. Cancelling does not end it: close() waits for it."""
        self._refuse_closed()
        running = self._executor.submit(function, *args)
        future = asyncio.wrap_future(running)
        self._pending[future] = running
        future.add_done_callback(self._ended)
        try:
            return await asyncio.shield(future)
        except asyncio.CancelledError:
            if running.cancelled():  # by close(), before it began
                raise VehicleError(_CLOSED) from None
            raise

    def _refuse_closed(self) -> None:
        if self._closed:
            raise VehicleError(_CLOSED)

    def _ended(self, future: asyncio.Future[Any]) -> None:
        del self._pending[future]
        if not future.cancelled():
            future.exception()  # retrieved, so that asyncio does not complain of a call nobody waits for any more

    async def close(self) -> None:
        """Stop feeding, take back calls not begun, wait for those under way, destroy once. Idempotent."""
        if self._closed:
            return
        self._closed = True
        self._unsubscribe()
        for running in tuple(self._pending.values()):
            running.cancel()  # leaves those that run alone: destroy() beside a call hangs
        if self._pending:
            await asyncio.wait(self._pending, timeout=_PENDING_S)
        if self._pending:
            # destroy() would hang for ever beside a call: leave it to the end of the process.
            log.error("%d MAVSDK calls did not end within %g s", len(self._pending), _PENDING_S)
        else:
            await self._loop.run_in_executor(self._executor, self._mavsdk.destroy)
        self._executor.shutdown(wait=False)
