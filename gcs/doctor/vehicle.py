"""The vehicle: heard, how often what comes, how late, its parameters. It is only asked, never told."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from control.types import VehicleState
from gcs import codec
from gcs.audit import Audit, judge, rules_of
from gcs.autopilot import Stream
from gcs.autopilot.parameters import read_parameters
from gcs.clock import MonotonicClock
from gcs.codec import VehicleId
from gcs.config import VehicleConfig
from gcs.doctor import judge_vehicle
from gcs.doctor.check import Question, Result, Say, fail, skip
from gcs.errors import GcsError, VehicleError, WireError
from gcs.framing import Message, dialect
from gcs.round_trip import RoundTrip
from gcs.signing import open_signing, security
from gcs.telemetry import Telemetry
from gcs.wire import Wire

_SETTLE_S = 1.5  # until what was asked for comes at its rate
_PING_S = 0.1


@dataclass(slots=True)
class Heard:
    """What came of a vehicle while it was watched. rates_hz: by the message's name. clock_s: how far its is ahead."""

    vehicle: VehicleId
    security: str
    state: VehicleState
    streams: tuple[Stream, ...]
    rates_hz: Mapping[str, float]
    loss_frac: float
    round_trips_s: list[float]
    audit: Audit
    others: tuple[str, ...] = ()
    stations: int = 0
    clock_s: float | None = None
    received_bytes_per_s: float = 0.0


def vehicle(question: Question, say: Say) -> Iterator[Result]:
    """Listen, ask, and judge."""
    if question.vehicle is None:
        yield skip("vehicle", "not looked at: give --vehicle URL, --profile or --config")
        return
    wanted = replace(question.config.vehicle, url=question.vehicle)
    try:
        heard = asyncio.run(listen(wanted, question.watch_s, say))
    except WireError as error:
        yield fail(
            "vehicle", str(error), "the link cannot be opened: see `port of the link`, or give another --vehicle URL"
        )
        return
    except VehicleError as error:
        on = "is the simulator running (`gcs sim`)" if wanted.simulated else "is it on"
        yield fail("vehicle", str(error), f"{on}, and does it send here? compare address, port and baud rate")
        return
    except GcsError as error:  # the key
        yield fail(
            "vehicle", str(error), "name the right key: --signing-key FILE, vehicle.signing_key (see `gcs keys`)"
        )
        return
    yield from judge_vehicle.judge(heard, question)


async def listen(wanted: VehicleConfig, watch_s: float, say: Say) -> Heard:
    """Ask for the streams as a flight does, and count what comes. GcsError where no vehicle is heard."""
    clock = MonotonicClock()
    signing = await asyncio.to_thread(open_signing, wanted.signing_key, clock)
    wire = await Wire.open(wanted.url, clock=clock, vehicle_system_id=wanted.system_id, signing=signing)
    try:
        telemetry = Telemetry(wire, clock)
        say(f"vehicle: waiting for one at {wire.url}")
        found = await wire.wait_vehicle(wanted.timeout_s)
        # No heartbeat of ours goes out from here on: a vehicle in the air might miss it when we leave.
        counter = _Counter(wire)
        asking = [asyncio.create_task(telemetry.run()), asyncio.create_task(counter.ping())]
        try:
            say(f"vehicle: {found}; asking for its parameters")
            names = [rule.names for rule in rules_of(found.autopilot.name, wanted.backend)]
            values = await read_parameters(wire, clock, names, lambda text: None)
            await asyncio.sleep(_SETTLE_S)
            say(f"vehicle: {found}; listening for {watch_s:g} s")
            counter.begin()
            await asyncio.sleep(watch_s)
            rates_hz = counter.rates_hz()
        finally:
            for task in asking:
                task.cancel()
            await asyncio.gather(*asking, return_exceptions=True)
        now_s = clock.now_s()
        return Heard(
            vehicle=found,
            security=security(wire.signing, wire.vehicle_signs),
            state=telemetry.vehicle_state(),
            streams=found.autopilot.streams,
            rates_hz=rates_hz,
            loss_frac=counter.loss_frac(),
            round_trips_s=counter.round_trips_s,
            audit=judge(found.autopilot.name, values, wanted.accept_parameters, wanted.backend),
            others=wire.other_vehicles(now_s),
            stations=len(telemetry.foreign_stations),
            clock_s=counter.clock_s,
            received_bytes_per_s=wire.figures(now_s).received_bytes_per_s,
        )
    finally:
        await wire.close()


@dataclass(slots=True)
class _Counter:
    """Counts the vehicle's messages, and asks for its time."""

    wire: Wire
    counts: Counter[str] = field(default_factory=Counter)
    round_trips_s: list[float] = field(default_factory=list)
    clock_s: float | None = None
    _begun_s: float = 0.0
    _lost_before: int = 0
    _round_trip: RoundTrip = field(default_factory=RoundTrip)

    def __post_init__(self) -> None:
        self.wire.subscribe(self._note)

    def begin(self) -> None:
        """Count from here on."""
        self.counts.clear()
        self.round_trips_s.clear()
        self._begun_s, self._lost_before = time.monotonic(), self.wire.loss.lost

    def rates_hz(self) -> dict[str, float]:
        """Since `begin`."""
        span_s = time.monotonic() - self._begun_s
        return {name: count / span_s for name, count in self.counts.items()}

    def loss_frac(self) -> float:
        """Of the vehicle's messages since `begin`."""
        lost = self.wire.loss.lost - self._lost_before
        return lost / max(1, lost + self.counts.total())

    async def ping(self) -> None:
        """TIMESYNC ten times a second, and once for the time of day; until cancelled."""
        vehicle = self.wire.vehicle
        assert vehicle is not None
        ask_time = codec.command(vehicle, dialect.MAV_CMD_REQUEST_MESSAGE, float(dialect.MAVLINK_MSG_ID_SYSTEM_TIME))
        self.wire.send_message(ask_time)
        while True:
            stamp_ns = self._round_trip.ask(time.monotonic())
            if stamp_ns is not None:
                self.wire.send_message(codec.timesync(stamp_ns))
            await asyncio.sleep(_PING_S)

    def _note(self, message: Message, t_s: float) -> None:
        vehicle = self.wire.vehicle
        if vehicle is None or not codec.is_from(message, vehicle):
            return
        kind = message.get_type()
        self.counts[kind] += 1
        if kind == "TIMESYNC":
            before = self._round_trip.rtt_s
            self._round_trip.note(message.tc1, message.ts1, t_s)
            if self._round_trip.rtt_s != before and self._round_trip.rtt_s is not None:
                self.round_trips_s.append(self._round_trip.rtt_s)
        elif kind == "SYSTEM_TIME" and message.time_unix_usec:
            self.clock_s = message.time_unix_usec / 1e6 - time.time()
