"""The only door for bytes to and from the vehicle: what leaves, leaves now or never."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from control.gate import Setpoint
from gcs import codec
from gcs.clock import Clock, MonotonicClock
from gcs.codec import VehicleId
from gcs.errors import VehicleError
from gcs.framing import Deframer, Encoder, FrameCounters, Message, dialect, split_ids
from gcs.tlog import TlogWriter
from gcs.transport import Endpoint, Kind, Peer, Received, Transport, open_transport, parse_url

STALE_S = 0.1  # older than this when it could leave, a frame is dropped: no burst after a stall
PEER_SILENCE_S = 3.0  # after so long without the vehicle's address, it may come from another one
SYSTEM_ID, COMPONENT_ID = 255, 191

# What moves a vehicle and must come from the gate; nobody else on this side may send it.
MOVING_MESSAGES = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MANUAL_CONTROL,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
        dialect.MAVLINK_MSG_ID_MANUAL_SETPOINT,
        dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    }
)

_NO_SOCKET = Endpoint(Kind.UDP_IN, host="in-process")
Subscriber: TypeAlias = Callable[[Message, float], None]
Unsubscribe: TypeAlias = Callable[[], None]


@dataclass(slots=True)
class WireCounters:
    """What has happened to frames on the way out, and to datagrams on the way in."""

    sent: int = 0
    setpoints_sent: int = 0
    stale: int = 0  # dropped: older than STALE_S when they could leave
    refused: int = 0  # dropped: kinds that only the gate may send, or no MAVLink at all
    unsent: int = 0  # dropped: nobody to send to, or the link is congested
    foreign_datagrams: int = 0  # ignored: not from the vehicle's address


class LossMeter:
    """Lost frames by gaps in the sequence numbers of one sender, over the last window."""

    def __init__(self, window_s: float = 2.0) -> None:
        self._window_s = window_s
        self._last: int | None = None
        self._events: deque[tuple[float, int]] = deque()  # (time of a received frame, lost before it)
        self.lost = 0

    def update(self, now_s: float, sequence: int) -> None:
        """Note a frame with this sequence number (0..255)."""
        missing = 0
        if self._last is not None:
            step = (sequence - self._last) % 256
            if step == 0 or step > 128:  # a duplicate, or late: counted as lost when it was overtaken
                return
            missing = step - 1
        self._last = sequence
        self.lost += missing
        self._events.append((now_s, missing))
        self._prune(now_s)

    def loss_frac(self, now_s: float) -> float:
        """Share of the window's frames that did not arrive, 0..1."""
        self._prune(now_s)
        lost = sum(missing for _, missing in self._events)
        return lost / (lost + len(self._events)) if self._events else 0.0

    def _prune(self, now_s: float) -> None:
        while self._events and self._events[0][0] < now_s - self._window_s:
            self._events.popleft()


class Wire:
    """One link to one vehicle; everything on the event loop that opened it.

    The first PX4 or ArduPilot multicopter heard (or the one of `vehicle_system_id`) is pinned: its address is
    answered, and others are ignored while it is heard. Frames are MAVLink 2 from system 255, component 191.
    """

    def __init__(self, endpoint: Endpoint, clock: Clock, encoder: Encoder, vehicle_system_id: int | None) -> None:
        self._endpoint = endpoint
        self._clock = clock
        self._encoder = encoder
        self._wanted_system_id = vehicle_system_id
        self._deframer = Deframer()
        self._transport: Transport | None = None
        self._connections = 0
        self._subscribers: list[Subscriber] = []
        self._peer: Peer | None = None
        self._peer_t_s = 0.0
        self._found = asyncio.Event()
        self._unusable = ""
        self._t_open_s = clock.now_s()
        self._tlog: TlogWriter | None = None
        self.vehicle: VehicleId | None = None
        self.counters = WireCounters()
        self.loss = LossMeter()

    @classmethod
    async def open(
        cls,
        url: str,
        *,
        clock: Clock | None = None,
        tlog: Path | None = None,
        vehicle_system_id: int | None = None,
        system_id: int = SYSTEM_ID,
        component_id: int = COMPONENT_ID,
    ) -> Wire:
        """Open the link of this URL; WireError if the address is wrong, taken or missing.

        clock must be the one whose time the gate is given. tlog: a file that must not exist yet.
        """
        endpoint = parse_url(url)
        wire = cls(endpoint, clock or MonotonicClock(), Encoder(system_id, component_id), vehicle_system_id)
        if tlog is not None:
            wire._tlog = TlogWriter.create(tlog)
        try:
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
    ) -> Wire:
        """A wire over any transport, made by calling the factory with what is to be called for bytes received.

        endpoint: names the link, and says whether bytes come as whole datagrams. Needs no event loop.
        """
        wire = cls(endpoint, clock, Encoder(system_id, component_id), vehicle_system_id)
        wire._transport = transport_factory(wire._received)
        return wire

    @property
    def url(self) -> str:
        """The address in its normal form."""
        return str(self._endpoint)

    @property
    def frames(self) -> FrameCounters:
        """Counters of the frames received."""
        return self._deframer.counters

    def subscribe(self, subscriber: Subscriber) -> Unsubscribe:
        """Call `subscriber(message, t_arrival_s)` for every valid message; returns how to end that."""
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def _received(self, data: bytes, peer: Peer | None) -> None:
        now_s = self._clock.now_s()
        if self._peer is not None and peer != self._peer and now_s - self._peer_t_s <= PEER_SILENCE_S:
            self.counters.foreign_datagrams += 1
            return
        for message in self._deframe(data):
            self._note(message, peer, now_s)
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

    def _note(self, message: Message, peer: Peer | None, now_s: float) -> None:
        if self.vehicle is None:
            self._pin(message)
        if self.vehicle is None or not codec.is_from(message, self.vehicle):
            return
        self.loss.update(now_s, message.get_seq())
        if peer is None:
            return
        if peer == self._peer:
            self._peer_t_s = now_s
        elif codec.identify(message) is not None:  # only a heartbeat may move us to another address
            self._peer, self._peer_t_s = peer, now_s
            assert self._transport is not None
            self._transport.reply_to(peer)

    def _pin(self, message: Message) -> None:
        vehicle = codec.identify(message)
        if vehicle is None:
            self._unusable = codec.unusable_reason(message) or self._unusable
        elif self._wanted_system_id not in (None, vehicle.system_id):
            self._unusable = f"heard {vehicle}, wanted system {self._wanted_system_id}"
        else:
            self.vehicle = vehicle
            self._found.set()

    async def wait_vehicle(self, timeout_s: float) -> VehicleId:
        """The vehicle, once its heartbeat has been heard; VehicleError says what was heard instead."""
        try:
            await asyncio.wait_for(self._found.wait(), timeout_s)
        except TimeoutError:
            raise VehicleError(f"no vehicle at {self.url} within {timeout_s:g} s: {self._heard()}") from None
        assert self.vehicle is not None
        return self.vehicle

    def _heard(self) -> str:
        if self._unusable:
            return self._unusable
        if self.frames.good:
            return "MAVLink was heard, but no autopilot's heartbeat"
        if self.frames.bad:
            return "something was heard, but it is not MAVLink (wrong port or baud rate?)"
        assert self._transport is not None
        return self._transport.status

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send what the gate made, once; False if it is stale or cannot leave now. Moves the vehicle."""
        if not isinstance(setpoint, Setpoint):
            kind = type(setpoint).__name__
            raise TypeError(f"only a control.gate.Setpoint may move the vehicle, not {kind}")
        if self.vehicle is None:
            self.counters.unsent += 1
            return False
        if self._is_stale(setpoint.t_s):  # before encoding, so that no sequence number is spent on it
            return False
        time_boot_ms = int((self._clock.now_s() - self._t_open_s) * 1000)
        sent = self._put(self._encoder.encode(codec.setpoint(setpoint, self.vehicle, time_boot_ms)))
        self.counters.setpoints_sent += sent
        return sent

    def send_message(self, message: Message) -> bool:
        """Send one message of ours (commands, requests); False if it cannot leave now.

        ValueError for messages that move the vehicle: those come from the gate only.
        """
        if message.get_msgId() in MOVING_MESSAGES:
            raise ValueError(f"{message.get_type()} moves the vehicle: only send_setpoint may")
        return self._put(self._encoder.encode(message))

    def send_heartbeat(self) -> bool:
        """Send our HEARTBEAT; called by the control task, so that it ends when the control task does."""
        return self.send_message(codec.heartbeat())

    def send_raw(self, data: bytes, t_enqueued_s: float) -> bool:
        """Send whole frames that another part made (MAVSDK) at t_enqueued_s; False if they were dropped."""
        ids = split_ids(data)
        if ids is None or not MOVING_MESSAGES.isdisjoint(ids):
            self.counters.refused += 1
            return False
        return not self._is_stale(t_enqueued_s) and self._put(data)

    def _is_stale(self, t_made_s: float) -> bool:
        stale = not self._clock.now_s() - t_made_s <= STALE_S  # so that NaN is stale
        self.counters.stale += stale
        return stale

    def _put(self, data: bytes) -> bool:
        if self._transport is None or not self._transport.send(data):
            self.counters.unsent += 1
            return False
        self.counters.sent += 1
        self._log(data)
        return True

    def _log(self, frame: bytes) -> None:
        if self._tlog is not None:
            self._tlog.write(frame, time.time())

    async def close(self) -> None:
        """Close the link and the log; sending afterwards does nothing."""
        transport, self._transport = self._transport, None
        if transport is not None:
            await transport.close()
        tlog, self._tlog = self._tlog, None
        if tlog is not None:
            await asyncio.to_thread(tlog.close)
