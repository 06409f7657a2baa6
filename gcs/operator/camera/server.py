"""The camera on its own UDP endpoint: sockets and tasks round the component."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from types import TracebackType
from typing import Final

from gcs.clock import Clock
from gcs.errors import GcsError, SelectionError, WireError, one_line
from gcs.framing import CodecError, Encoder, Message
from gcs.operator.camera.component import CameraComponent, Out, Say
from gcs.operator.camera.definition import Definition, definition
from gcs.operator.camera.facts import Where
from gcs.operator.camera.intake import Intake
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask, Problem
from gcs.operator.camera.parameter_types import parameters
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.lease import Lease
from gcs.operator.station import Station
from gcs.transport import Kind, Peer, Transport, open_transport, parse_url

_MOST_ENCODERS: Final = 64
log = logging.getLogger(__name__)


def definition_of(setup: CameraSetup) -> Definition:
    """The camera definition of such a camera; `gcs.operator.camera.definition.routes` serves it."""
    return definition(parameters(setup))


class CameraServer:
    """Made by `open`; speaks while `run` runs, until `close`."""

    def __init__(
        self, component: CameraComponent, station: Station, clock: Clock, say: Callable[[str], None] = log.warning
    ) -> None:
        self._component = component
        self._station = station
        self._clock = clock
        self._say = say
        self._intake = Intake()
        self._encoders: dict[Peer | None, Encoder] = {}  # each client counts what it misses
        self._transport: Transport | None = None
        self._one_peer = False
        self._wake = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._unwatch = station.watch(component.view)

    @classmethod
    async def open(
        cls,
        url: str,
        setup: CameraSetup,
        station: Station,
        lease: Lease,
        clock: Clock,
        where: Where | None = None,
        say: Callable[[str], None] = log.warning,
    ) -> CameraServer:
        """Open the endpoint (udpout or udpin). WireError in one line if the address is wrong or taken.

        setup: its definition's version is filled in here. where: the target's place, where it can be told. say: a line
        for the people at the ground station.
        """
        setup = replace(setup, definition_version=definition_of(setup).version if setup.definition_url else 0)
        try:
            endpoint = parse_url(url)
            if not endpoint.is_datagram:
                raise WireError(f"vehicle address {url!r}: needs udpout://HOST:PORT or udpin://HOST:PORT")
            server = cls(CameraComponent(setup, station, lease, clock.now_s(), where), station, clock, say)
            server._one_peer = endpoint.kind is Kind.UDP_OUT
            try:
                server._transport = await open_transport(endpoint, server._received)
            except BaseException:
                server._unwatch()
                raise
        except WireError as error:
            raise WireError(str(error).replace("vehicle address", "MAVLink camera at", 1)) from None
        return server

    @property
    def setup(self) -> CameraSetup:
        """What it is."""
        return self._component.setup

    def _received(self, data: bytes, peer: Peer | None) -> None:
        now_s, peer = self._clock.now_s(), None if self._one_peer else peer
        due_s = self._component.due_s
        for message in self._intake.messages(data, peer, now_s, known=self._component.knows(peer)):
            self._act(self._component.received(message, peer, now_s))
        if self._component.due_s < due_s:
            self._wake.set()

    async def run(self) -> None:
        """Say what is due when it is due, for ever."""
        while True:
            now_s = self._clock.now_s()
            try:
                self._act(self._component.tick(now_s))
            except Exception:  # the edge of this task: a fault of the camera must not end the flight
                log.exception("MAVLink camera")
                await asyncio.sleep(1.0)
            self._wake.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(max(self._component.due_s - self._clock.now_s(), 0.0)):
                    await self._wake.wait()

    def _act(self, found: Iterable[Out | Ask | Say]) -> None:
        for each in found:
            if isinstance(each, Ask):
                task = asyncio.get_running_loop().create_task(self._perform(each))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            elif isinstance(each, Say):
                self._say(each.text)
            else:
                self._send(each.message, each.peer)

    async def _perform(self, ask: Ask) -> None:
        problem = None
        try:
            await self._station.perform(ask.order)
        except (SelectionError, ValueError) as error:
            problem = Problem(Result.DENIED, one_line(error))
        except GcsError as error:
            problem = Problem(Result.TEMPORARILY_REJECTED, one_line(error))
        except Exception:  # the edge of this task: whoever ordered must hear that it failed
            log.exception("MAVLink camera: %s", type(ask.order).__name__)
            problem = Problem(Result.FAILED, "a fault of the ground station: see its log")
        self._act(self._component.settled(ask, problem, self._clock.now_s()))

    def _send(self, message: Message, peer: Peer | None) -> None:
        if self._transport is None:
            return
        if peer not in self._encoders:
            if len(self._encoders) >= _MOST_ENCODERS:
                del self._encoders[next(iter(self._encoders))]
            self._encoders[peer] = Encoder(self.setup.system_id, self.setup.component_id)
        try:
            data = self._encoders[peer].encode(message)
        except CodecError as error:  # a fact that does not fit: this message is left out, the rest goes on
            log.warning("MAVLink camera: %s", error)
            return
        if peer is not None:
            self._transport.reply_to(peer)
        self._transport.send(data)

    async def close(self) -> None:
        """Give the port back; what is being performed is not waited for."""
        self._unwatch()
        for task in tuple(self._tasks):
            task.cancel()
        transport, self._transport = self._transport, None
        if transport is not None:
            await transport.close()

    async def __aenter__(self) -> CameraServer:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
