"""What the vehicle says, gathered: its state with ages, attitude history, texts, command answers."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from control.attitude import AttitudeBuffer
from control.types import Vec3, VehicleMode, VehicleState
from gcs import codec
from gcs.clock import Clock
from gcs.codec import VehicleId
from gcs.errors import VehicleError
from gcs.framing import Message, dialect
from gcs.home_frame import Home, HomeFrame, VehiclePlace
from gcs.round_trip import RoundTrip
from gcs.statustext import StatusText, StatusTextAssembler
from gcs.streams import StreamKeeper
from gcs.wire import COMPONENT_ID, SYSTEM_ID, Wire

LINK_LOST_S = 3.0  # heartbeat silence after which the vehicle counts as having been away
_ASK_PERIOD_S = 0.25
_TEXTS = 50
_ACKS = 50
_OUR_STATIONS = ((SYSTEM_ID, COMPONENT_ID), (245, 190))  # the second is MAVSDK's
_MOST_STATIONS = 16
_REBOOT_MS = 5000  # time_boot_ms may jump back by less, when datagrams overtake each other


@dataclass(frozen=True, slots=True)
class Ack:
    """COMMAND_ACK to us: MAV_CMD, MAV_RESULT."""

    t_s: float
    command: int
    result: int

    @property
    def result_name(self) -> str:
        """As the MAVLink standard writes it, without MAV_RESULT_."""
        entry = dialect.enums["MAV_RESULT"].get(self.result)
        return str(entry.name.removeprefix("MAV_RESULT_")) if entry else f"result {self.result}"


@dataclass(frozen=True, slots=True)
class SetpointEcho:
    """POSITION_TARGET_LOCAL_NED: the velocity (m/s, NED) the vehicle says it is following."""

    t_s: float
    velocity_ned_mps: Vec3


class Telemetry:
    """Listens on a wire; `run()` asks for the streams. All on the wire's event loop."""

    def __init__(self, wire: Wire, clock: Clock, *, attitude: AttitudeBuffer | None = None) -> None:
        self._wire = wire
        self._clock = clock
        self._state = VehicleState()
        self._local_t_s: float | None = None
        self._height_t_s: float | None = None
        self._boot_ms: int | None = None
        self._keeper: StreamKeeper | None = None
        self._assembler = StatusTextAssembler()
        self._waiting: list[tuple[Callable[[VehicleState], bool], asyncio.Future[None]]] = []
        self._unsubscribe = wire.subscribe(self.on_message)
        self.attitude = attitude if attitude is not None else AttitudeBuffer()
        self.texts: deque[StatusText] = deque(maxlen=_TEXTS)
        self.acks: deque[Ack] = deque(maxlen=_ACKS)
        self.intended_mode = VehicleMode.UNKNOWN  # PX4: where a failsafe would return to by itself
        self.prearm_ok: bool | None = None  # SYS_STATUS: the vehicle's own pre-arm checks
        self.home: Home | None = None  # as last told
        self.place: VehiclePlace | None = None  # where it is on the earth
        self.home_frame = HomeFrame()
        self.setpoint_echo: SetpointEcho | None = None
        self.round_trip = RoundTrip()
        self.foreign_stations: dict[tuple[int, int], float] = {}  # (system, component) -> last heard, s
        self.reconnects = 0

    @property
    def vehicle(self) -> VehicleId:
        """The pinned vehicle; VehicleError before one was heard."""
        if self._wire.vehicle is None:
            raise VehicleError(f"no vehicle has been heard at {self._wire.url} yet")
        return self._wire.vehicle

    def vehicle_state(self) -> VehicleState:
        """The newest of everything, positions from home. position_t_s: the older of position's and height's."""
        position_ned_m = self.home_frame.from_home(self._state.position_ned_m)
        if self._local_t_s is None or self._height_t_s is None:
            return replace(self._state, position_ned_m=position_ned_m, position_t_s=None)
        position_t_s = min(self._local_t_s, self._height_t_s)
        return replace(self._state, position_ned_m=position_ned_m, position_t_s=position_t_s)

    def on_message(self, message: Message, t_s: float) -> None:
        """A valid message of anybody arrived at t_s."""
        vehicle = self._wire.vehicle
        if codec.is_gcs_heartbeat(message):
            self._station((message.get_srcSystem(), message.get_srcComponent()), t_s)
        if vehicle is None or not codec.is_from(message, vehicle):
            return
        if self._keeper is None:
            self._keeper = StreamKeeper(vehicle.autopilot.streams)
        self._notice_return(message, t_s)
        self._keeper.heard(message.get_msgId(), t_s)
        self._state = codec.update(self._state, message, t_s, vehicle)
        self._note(message, t_s, vehicle)
        self._wake()

    def _notice_return(self, message: Message, t_s: float) -> None:
        kind = message.get_type()
        away = kind == "HEARTBEAT" and t_s - (self._state.heartbeat_t_s or t_s) > LINK_LOST_S
        rebooted = False
        if kind == "ATTITUDE":
            rebooted = self._boot_ms is not None and message.time_boot_ms < self._boot_ms - _REBOOT_MS
            self._boot_ms = message.time_boot_ms
        if away or rebooted:
            self.reconnects += 1
            assert self._keeper is not None
            self._keeper.restart()

    def _note(self, message: Message, t_s: float, vehicle: VehicleId) -> None:
        match message.get_type():
            case "ATTITUDE" if self._state.attitude_t_s == t_s:
                state = self._state
                # Pictures and attitude must be of one clock: what is heard now was so a way of the link ago.
                t_s -= self.round_trip.one_way_s or 0.0
                self.attitude.add(t_s, state.roll_rad, state.pitch_rad, state.yaw_rad)
            case "LOCAL_POSITION_NED" if self._state.position_t_s == t_s:
                self._local_t_s = t_s
            case "GLOBAL_POSITION_INT":
                self._height_t_s = t_s
                self._place(message, t_s)
            case "STATUSTEXT":
                self.texts.extend(self._assembler.add(message, t_s))
            case "COMMAND_ACK":
                self._ack(message, t_s)
            case "CURRENT_MODE":
                self.intended_mode = vehicle.autopilot.mode_of(message.intended_custom_mode)
            case "SYS_STATUS":
                self.prearm_ok = _prearm_ok(message)
            case "HOME_POSITION":
                self.home = Home(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
            case "POSITION_TARGET_LOCAL_NED":
                self._echo(message, t_s)
            case "TIMESYNC":
                self.round_trip.note(message.tc1, message.ts1, t_s)

    def _place(self, message: Message, t_s: float) -> None:
        if (message.lat, message.lon) != (0, 0):
            self.place = VehiclePlace(t_s, message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        if self.home is not None and self._local_t_s is not None:
            place_deg = message.lat / 1e7, message.lon / 1e7
            local_ned_m, in_air = self._state.position_ned_m, self._state.in_air
            self.home_frame.heard(self.home, place_deg, local_ned_m, in_air=in_air)

    def _ack(self, message: Message, t_s: float) -> None:
        target = (message.target_system, message.target_component)
        # ArduPilot and old MAVLink leave the target 0; MAVSDK's answers are not ours to read.
        if target[0] in (0, SYSTEM_ID) and target[1] in (0, COMPONENT_ID):
            self.acks.append(Ack(t_s, message.command, message.result))
        else:
            self._station(target, t_s)

    def _echo(self, message: Message, t_s: float) -> None:
        velocity = (message.vx, message.vy, message.vz)
        if all(map(math.isfinite, velocity)):
            self.setpoint_echo = SetpointEcho(t_s, velocity)

    def _station(self, station: tuple[int, int], t_s: float) -> None:
        """A ground station was heard, or the vehicle answered one."""
        known = station in self.foreign_stations or len(self.foreign_stations) < _MOST_STATIONS
        if station not in _OUR_STATIONS and known:
            self.foreign_stations[station] = t_s

    def texts_since(self, t_s: float, max_severity: int = 5) -> list[StatusText]:
        """Texts that began at or after t_s and are at least this severe (5 = notice)."""
        return [text for text in self.texts if text.t_s >= t_s and text.severity <= max_severity]

    def ack_since(self, t_s: float, command: int) -> Ack | None:
        """The newest answer to this command since t_s."""
        for ack in reversed(self.acks):
            if ack.t_s >= t_s and ack.command == command:
                return ack
        return None

    async def wait_for(self, condition: Callable[[VehicleState], bool], timeout_s: float) -> bool:
        """Wait until a message makes the condition true; False after timeout_s."""
        if condition(self.vehicle_state()):
            return True
        future = asyncio.get_running_loop().create_future()
        waiter = (condition, future)
        self._waiting.append(waiter)
        try:
            await asyncio.wait_for(future, timeout_s)
        except TimeoutError:
            return False
        finally:
            self._waiting.remove(waiter)
        return True

    def _wake(self) -> None:
        if not self._waiting:
            return
        state = self.vehicle_state()
        for condition, future in self._waiting:
            if not future.done() and condition(state):
                future.set_result(None)

    def ask(self, now_s: float) -> int:
        """Send the stream requests that are due, and finish texts whose rest was lost; returns how many."""
        self.texts.extend(self._assembler.expire(now_s))
        vehicle, heartbeat_t_s = self._wire.vehicle, self._state.heartbeat_t_s
        if self._keeper is None or vehicle is None or heartbeat_t_s is None:
            return 0
        if now_s - heartbeat_t_s > LINK_LOST_S:
            return 0
        due = self._keeper.due(now_s)
        for stream in due:
            self._wire.send_message(codec.set_message_interval(vehicle, stream.message_id, stream.rate_hz))
        return len(due)

    def missing_streams(self, now_s: float) -> list[str]:
        """Names of the streams asked for that do not flow."""
        missing = self._keeper.missing(now_s) if self._keeper is not None else []
        return [dialect.mavlink_map[stream.message_id].msgname for stream in missing]

    async def run(self) -> None:
        """Keep the streams flowing until cancelled."""
        while True:
            self.ask(self._clock.now_s())
            await asyncio.sleep(_ASK_PERIOD_S)

    def close(self) -> None:
        """Stop listening."""
        self._unsubscribe()


def _prearm_ok(message: Message) -> bool | None:
    """SYS_STATUS: None where the vehicle does not report the check."""
    bit = dialect.MAV_SYS_STATUS_PREARM_CHECK
    if not message.onboard_control_sensors_present & bit:
        return None
    return bool(message.onboard_control_sensors_health & bit)
