"""The only door for bytes to and from the vehicle: what leaves, leaves now or never."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TypeAlias

from control.gate import Setpoint
from gcs import codec
from gcs.backend import Backend
from gcs.clock import Clock, MonotonicClock
from gcs.codec import PublishedTarget, VehicleId
from gcs.errors import VehicleError
from gcs.framing import Deframer, Encoder, FrameCounters, Message, message_id, split_frames
from gcs.link_meters import LinkFigures, LossMeter, SlidingSum, WireCounters
from gcs.pinning import VehiclePin
from gcs.recorder.tlog import TlogWriter
from gcs.signing import Signing, is_signed
from gcs.transport import Endpoint, Kind, Peer, Received, Transport, open_transport, parse_url

STALE_S = 0.1  # older than this when it could leave, a frame is dropped: no burst after a stall
PEER_SILENCE_S = 3.0  # after so long without the vehicle's address, it may come from another one
_HELLO_S = 0.5
SYSTEM_ID, COMPONENT_ID = 255, 191

_NO_SOCKET = Endpoint(Kind.UDP_IN, host="in-process")
Subscriber: TypeAlias = Callable[[Message, float], None]


class Wire:
    """One link to one vehicle; everything on the event loop that opened it.

    The first PX4 or ArduPilot multicopter heard (or the one of `vehicle_system_id`) is pinned: its address is
    answered, and others are ignored while it is heard. Frames are MAVLink 2 from system 255, component 191;
    with `signing` they are signed, and what is not signed so is not received.
    """

    def __init__(
        self, endpoint: Endpoint, clock: Clock, encoder: Encoder, pin: VehiclePin, signing: Signing | None
    ) -> None:
        self._endpoint = endpoint
        self._clock = clock
        self._encoder = encoder
        self._pin = pin
        self._deframer = Deframer()
        self._transport: Transport | None = None
        self._connections = 0
        self._closed = False
        self._subscribers: list[Subscriber] = []
        self._peer: Peer | None = None
        self._peer_t_s = 0.0
        self._found = asyncio.Event()
        self._t_open_s = clock.now_s()
        self._tlog: TlogWriter | None = None
        self._received_rate = SlidingSum()
        self._sent_rate = SlidingSum()
        self.signing = signing
        self.vehicle_signs = False
        self.counters = WireCounters()
        self.loss = LossMeter()

    @classmethod
    async def open(
        cls,
        url: str,
        *,
        clock: Clock | None = None,
        tlog: TlogWriter | None = None,
        vehicle_system_id: int | None = None,
        system_id: int = SYSTEM_ID,
        component_id: int = COMPONENT_ID,
        signing: Signing | None = None,
        backend: Backend = Backend.SETPOINTS,
    ) -> Wire:
        """Open the link of this URL; WireError if the address is wrong, taken or missing.

        clock: the one whose time the gate is given. tlog: of both directions, left open. signing: closed with us.
        """
        encoder, pin = Encoder(system_id, component_id), VehiclePin(vehicle_system_id, backend)
        endpoint = parse_url(url)
        wire = cls(endpoint, clock or MonotonicClock(), encoder, pin, signing)
        try:
            wire._tlog = tlog
            wire._transport = await open_transport(endpoint, wire._received)
        except BaseException:
            await wire.close()
            raise
        return wire

    @classmethod
    def over(
        cls,
        transport_factory: Callable[[Received], Transport],
        *,
        clock: Clock,
        endpoint: Endpoint = _NO_SOCKET,
        vehicle_system_id: int | None = None,
        system_id: int = SYSTEM_ID,
        component_id: int = COMPONENT_ID,
        signing: Signing | None = None,
        backend: Backend = Backend.SETPOINTS,
    ) -> Wire:
        """A wire over any transport, made by calling the factory with what is to be called for bytes received.

        endpoint: names the link, and says whether bytes come as whole datagrams. Needs no event loop.
        """
        encoder, pin = Encoder(system_id, component_id), VehiclePin(vehicle_system_id, backend)
        wire = cls(endpoint, clock, encoder, pin, signing)
        wire._transport = transport_factory(wire._received)
        return wire

    @property
    def url(self) -> str:
        """The address in its normal form."""
        return str(self._endpoint)

    @property
    def vehicle(self) -> VehicleId | None:
        """The pinned vehicle; None before one was heard."""
        return self._pin.vehicle

    @property
    def frames(self) -> FrameCounters:
        """Counters of the frames received."""
        return self._deframer.counters

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call `subscriber(message, t_arrival_s)` for every valid message; returns how to end that."""
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def _received(self, data: bytes, peer: Peer | None) -> None:
        now_s = self._clock.now_s()
        if self._peer is not None and peer != self._peer and now_s - self._peer_t_s <= PEER_SILENCE_S:
            self.counters.foreign_datagrams += 1
            self._pin.glance(data, peer, now_s)
            return
        self.counters.bytes_received += len(data)
        believed = (lambda frame: True) if self.signing is None else self.signing.accepts
        messages = [message for message in self._deframe(data) if believed(message.get_msgbuf())]
        self._received_rate.add(now_s, len(messages), len(data))
        for message in messages:
            if not self._note(message, peer, now_s):
                continue
            self._log(bytes(message.get_msgbuf()))
            for subscriber in tuple(self._subscribers):
                subscriber(message, now_s)

    def _deframe(self, data: bytes) -> list[Message]:
        if self._endpoint.is_datagram:
            return self._deframer.datagram(data)
        if self._transport is not None and self._transport.connections != self._connections:
            self._connections = self._transport.connections
            self._deframer.reset()
        return self._deframer.stream(data)

    def _note(self, message: Message, peer: Peer | None, now_s: float) -> bool:
        """False: drop it, it comes from another autopilot under the vehicle's ids."""
        if not self._pin.is_ours(message, now_s):
            return not self._pin.is_impostor(message)
        self._found.set()
        self.vehicle_signs = is_signed(message.get_msgbuf())
        self.loss.update(now_s, message.get_seq())
        if peer == self._peer:
            self._peer_t_s = now_s
        elif peer is not None and codec.identify(message) is not None:  # only a heartbeat moves us to another address
            self._peer, self._peer_t_s = peer, now_s
            assert self._transport is not None
            self._transport.reply_to(peer)
        return True

    async def wait_vehicle(self, timeout_s: float) -> VehicleId:
        """The vehicle, once its heartbeat has been heard; VehicleError says what was heard instead.

        Our own goes out meanwhile: some wait for one, and a signed one sets a clock that is behind.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.vehicle is None:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(self._found.wait(), _HELLO_S)
                    if self.vehicle is None:
                        self.send_heartbeat()
        if self.vehicle is None:
            raise VehicleError(f"no vehicle at {self.url} within {timeout_s:g} s: {self._heard()}")
        return self.vehicle

    def _heard(self) -> str:
        if self._pin.unusable:
            return self._pin.unusable
        if self.signing is not None and self.signing.refused:
            return "MAVLink was heard, but its signature is missing or wrong (the vehicle's key is another one?)"
        if self.frames.good:
            return "MAVLink was heard, but no autopilot's heartbeat"
        if self.frames.bad:
            return "something was heard, but it is not MAVLink (wrong port or baud rate?)"
        assert self._transport is not None
        return self._transport.status

    def other_vehicles(self, now_s: float) -> tuple[str, ...]:
        """Vehicles heard in the last seconds that are not ours, and are ignored."""
        return self._pin.others(now_s)

    def figures(self, now_s: float) -> LinkFigures:
        """The link in numbers."""
        return LinkFigures(
            *self._received_rate.per_s(now_s),
            *self._sent_rate.per_s(now_s),
            loss_frac=self.loss.loss_frac(now_s),
            good_frames=self.frames.good,
            bad_frames=self.frames.bad,
            refused_frames=self.signing.refused if self.signing is not None else 0,
            totals=replace(self.counters),
        )

    def send_setpoint(self, setpoint: Setpoint, target: PublishedTarget | None = None) -> bool:
        """Send what the gate made (or, by its permit, `target`), once; False if it is stale or cannot leave now."""
        if not isinstance(setpoint, Setpoint):
            raise TypeError(f"only a control.gate.Setpoint may move the vehicle, not {type(setpoint).__name__}")
        if self.vehicle is None:
            self.counters.unsent += 1
            return False
        if self._is_stale(setpoint.t_s):  # before encoding, so that no sequence number is spent on it
            return False
        time_boot_ms = int((self._clock.now_s() - self._t_open_s) * 1000)
        made = codec.setpoint(setpoint, self.vehicle, time_boot_ms)
        sent = self._put(self._encoder.encode(made if target is None else codec.follow_target(target, time_boot_ms)))
        self.counters.setpoints_sent += sent
        return sent

    def send_message(self, message: Message, t_made_s: float | None = None) -> bool:
        """Send one message of ours (commands, requests); False if it cannot leave now.

        t_made_s: when it was decided on, if earlier; then it may be stale. ValueError if it moves the vehicle: that
        comes from the gate only.
        """
        if message.get_msgId() in codec.MOVING_MESSAGES:
            raise ValueError(f"{message.get_type()} moves the vehicle: only send_setpoint may")
        if t_made_s is not None and self._is_stale(t_made_s):
            return False
        return self._put(self._encoder.encode(message))

    def send_heartbeat(self) -> bool:
        """Send our HEARTBEAT; called by the control task, so that it ends when the control task does."""
        return self.send_message(codec.heartbeat())

    def send_raw(self, data: bytes, t_enqueued_s: float) -> bool:
        """Send whole frames that another part made (MAVSDK) at t_enqueued_s; False if they were dropped."""
        frames = split_frames(data)
        if frames is None or not codec.MOVING_MESSAGES.isdisjoint(map(message_id, frames)):
            self.counters.refused += 1
            return False
        return not self._is_stale(t_enqueued_s) and self._put(*frames)

    def _is_stale(self, t_made_s: float) -> bool:
        stale = not self._clock.now_s() - t_made_s <= STALE_S  # so that NaN is stale
        self.counters.stale += stale
        return stale

    def _put(self, *frames: bytes) -> bool:
        """Into one datagram; signed here, in the order of leaving."""
        try:
            data = b"".join(frames if self.signing is None else map(self.signing.sign, frames))
        except ValueError:  # unknown to us, or MAVLink 1: it would leave unsigned
            self.counters.refused += 1
            return False
        if self._transport is None or not self._transport.send(data):
            self.counters.unsent += 1
            return False
        self.counters.sent += 1
        self.counters.bytes_sent += len(data)
        self._sent_rate.add(self._clock.now_s(), len(frames), len(data))
        self._log(data)
        return True

    def _log(self, frame: bytes) -> None:
        if self._tlog is not None:
            self._tlog.write(frame, time.time())

    async def close(self) -> None:
        """Close the link; sending afterwards does nothing."""
        if self._closed:
            return
        self._closed = True
        transport, self._transport = self._transport, None
        if transport is not None:
            await transport.close()
        if self.signing is not None:
            with ThreadPoolExecutor(1) as disk:  # the default executor may be busy with other work for long
                await asyncio.get_running_loop().run_in_executor(disk, self.signing.close)
