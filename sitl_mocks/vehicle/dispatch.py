"""What the mock vehicle does with each incoming message: addressing, acknowledgements, parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle.autopilot import GCS_TYPE
from sitl_mocks.vehicle.flight import Sticks
from sitl_mocks.vehicle.follow_target import parse_target
from sitl_mocks.vehicle.link import Outbox
from sitl_mocks.vehicle.modes import Personality, Result, Severity
from sitl_mocks.vehicle.setpoints import BadSetpointError, parse_setpoint
from sitl_mocks.vehicle.streams import AUTOPILOT_VERSION, HEARTBEAT
from sitl_mocks.vehicle.telemetry import BUILDERS

if TYPE_CHECKING:
    from sitl_mocks.vehicle.core import MockVehicle

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
_PARAM_SPACING_S = 0.001
# Real streams of the autopilots that this vehicle accepts to stream but has no contents for.
_STREAMS_WITHOUT_CONTENT = {
    Personality.PX4: frozenset({29, 36, 42, 62, 65, 105, 132, 241}),
    Personality.ARDUPILOT: frozenset({26, 27, 29, 36, 42, 62, 65, 105, 116, 132, 193, 241}),
}
# Measured on PX4: accepted, but the message does not come.
_PX4_NEVER_COMES = frozenset({300, 397})


class Dispatcher:
    """Routes messages by type. What is addressed to someone else, or unknown, gets no answer at all."""

    def __init__(self, vehicle: MockVehicle, outbox: Outbox, also: Outbox | None = None) -> None:
        """outbox: where answers go. also: where COMMAND_ACKs are repeated."""
        self._vehicle = vehicle
        self._outbox = outbox
        self._also = also
        self._handlers: Mapping[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
            "FOLLOW_TARGET": self._follow_target,
            "PARAM_REQUEST_READ": self._param_read,
            "PARAM_REQUEST_LIST": self._param_list,
            "PARAM_SET": self._param_set,
            "PING": self._ping,
            "TIMESYNC": self._timesync,
            "SETUP_SIGNING": self._setup_signing,
            "MANUAL_CONTROL": self._manual_control,
            "RC_CHANNELS_OVERRIDE": self._rc_override,
        }

    def handle(self, message: Any, now_s: float) -> None:
        """Act on one message; answers go into the vehicle's outbox."""
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(message, now_s)

    @property
    def _px4(self) -> bool:
        return self._vehicle.personality is Personality.PX4

    def _for_us(self, message: Any) -> bool:
        if message.target_system not in (0, self._outbox.system_id):
            return False
        # ArduCopter executes what is addressed to components that do not exist.
        return not self._px4 or message.target_component in (0, self._outbox.component_id)

    # -- commands -----------------------------------------------------------------------------------------

    def _command_long(self, message: Any, now_s: float) -> None:
        params = [getattr(message, f"param{number}") for number in range(1, 8)]
        self._command(message, params, now_s)

    def _command_int(self, message: Any, now_s: float) -> None:
        params = [getattr(message, f"param{number}") for number in range(1, 5)]
        self._command(message, [*params, message.x, message.y, message.z], now_s)

    def _command(self, message: Any, params: Sequence[float], now_s: float) -> None:
        if not self._for_us(message):
            return
        faults = self._vehicle.faults
        result: Result | None
        if message.command in faults.accept_without_effect:
            result = Result.ACCEPTED
        elif message.command in faults.refuse:
            result = faults.refuse[message.command]
            if self._px4 and result is Result.TEMPORARILY_REJECTED:
                self._vehicle.autopilot.say(Severity.CRITICAL, "Command refused by the test\t")
        elif message.command == SET_MESSAGE_INTERVAL:
            result = self._set_interval(params, now_s)
        elif message.command == REQUEST_MESSAGE:
            result = self._request_message(params[0], now_s)
        else:
            result = self._vehicle.autopilot.execute(message.command, params, now_s)
        if result is not None:
            self._acknowledge(message, result, now_s)

    def _acknowledge(self, message: Any, result: Result, now_s: float) -> None:
        ack = mavlink.MAVLink_command_ack_message(
            message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        due_s = self._outbox.answer_time_s(now_s)
        self._outbox.put(ack, due_s)
        if self._also is not None:
            self._also.put(ack, due_s)

    def _set_interval(self, params: Sequence[float], now_s: float) -> Result:
        number, interval_us = (-1 if not math.isfinite(p) else round(p) for p in params[:2])
        fixed = self._px4 and number == HEARTBEAT
        if number in _STREAMS_WITHOUT_CONTENT[self._vehicle.personality]:
            return Result.ACCEPTED
        if fixed or number == AUTOPILOT_VERSION or number not in BUILDERS:
            if self._px4:
                return Result.FAILED
            self._vehicle.autopilot.say(Severity.NOTICE, f"No ap_message for mavlink id ({number})")
            return Result.DENIED
        self._vehicle.streams.set_interval(number, interval_us, now_s)
        return Result.ACCEPTED

    def _request_message(self, number: float, now_s: float) -> Result:
        wanted = round(number) if math.isfinite(number) else -1
        if wanted in BUILDERS:
            self._outbox.put(self._vehicle.message(wanted, now_s), self._outbox.answer_time_s(now_s))
            return Result.ACCEPTED
        if self._px4:
            return Result.ACCEPTED if wanted in _PX4_NEVER_COMES else Result.DENIED
        return Result.FAILED

    # -- setpoints, heartbeats, time -------------------------------------------------------------------------

    def _setpoint(self, message: Any, now_s: float) -> None:
        if not self._for_us(message):
            return
        pilot = self._vehicle.autopilot
        yaw_rad = pilot.flight.body.motion.yaw_rad
        try:
            pilot.take_setpoint(parse_setpoint(message, self._vehicle.personality, yaw_rad, now_s))
        except BadSetpointError as error:
            pilot.bad_setpoint(error)

    def _follow_target(self, message: Any, now_s: float) -> None:
        """Addressed to nobody: each vehicle decides whom it listens to."""
        place = self._vehicle.home.offset_ned_m(message.lat / 1e7, message.lon / 1e7, message.alt)
        heard = parse_target(message, place, now_s)
        follower = self._vehicle.autopilot.flight.follower
        if heard is not None and follower is not None:
            follower.hear(heard)

    def _heartbeat(self, message: Any, now_s: float) -> None:
        if message.type == GCS_TYPE:
            self._vehicle.autopilot.hear_gcs(message.get_srcSystem(), now_s)

    def _ping(self, message: Any, now_s: float) -> None:
        if message.target_system == 0 and self._px4:
            sender = message.get_srcSystem(), message.get_srcComponent()
            self._outbox.put(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender), now_s)

    def _timesync(self, message: Any, now_s: float) -> None:
        if message.tc1 == 0:
            boot_ns = round(self._vehicle.view(now_s).boot_s * 1e9)
            self._outbox.put(mavlink.MAVLink_timesync_message(boot_ns, message.ts1), now_s)

    def _setup_signing(self, message: Any, now_s: float) -> None:
        """Taken on the ground only; once there is a key, an unsigned one does not get this far."""
        del now_s
        if self._for_us(message) and not self._vehicle.autopilot.armed:
            self._vehicle.signing.set_up(bytes(message.secret_key), message.initial_timestamp)

    # -- sticks ---------------------------------------------------------------------------------------------

    def _manual_control(self, message: Any, now_s: float) -> None:
        if message.target == self._outbox.system_id:
            axes = (message.x / 1000, message.y / 1000, (message.z - 500) / 500, message.r / 1000)
            self._sticks(message, axes, now_s)

    def _rc_override(self, message: Any, now_s: float) -> None:
        if message.target_system != self._outbox.system_id:
            return
        channels = (message.chan2_raw, message.chan1_raw, message.chan3_raw, message.chan4_raw)
        forward, right, up, clockwise = (0.0 if c in (0, 65535) else (c - 1500) / 500 for c in channels)
        self._sticks(message, (-forward, right, up, clockwise), now_s)

    def _sticks(self, message: Any, axes: tuple[float, float, float, float], now_s: float) -> None:
        pilot = self._vehicle.autopilot
        if self._px4 or pilot.counts_as_gcs(message.get_srcSystem()):  # ArduCopter takes sticks from its own station
            pilot.hear_sticks(Sticks(*(max(-1.0, min(1.0, axis)) for axis in axes)), now_s)

    # -- parameters -----------------------------------------------------------------------------------------

    def _param_read(self, message: Any, now_s: float) -> None:
        names = self._vehicle.params.names()
        if message.param_index >= 0:
            name = names[message.param_index] if message.param_index < len(names) else ""
        else:
            name = message.param_id
        if self._for_us(message) and self._answers_for(name):
            self._send_param(name, self._outbox.answer_time_s(now_s))

    def _answers_for(self, name: str) -> bool:
        return name in self._vehicle.params and name not in self._vehicle.faults.silent_parameters

    def _param_list(self, message: Any, now_s: float) -> None:
        if not self._for_us(message):
            return
        for index, name in enumerate(self._vehicle.params.names()):
            if self._answers_for(name):
                self._send_param(name, now_s + (index + 1) * _PARAM_SPACING_S)

    def _param_set(self, message: Any, now_s: float) -> None:
        if not self._for_us(message) or not self._answers_for(message.param_id):
            return
        self._vehicle.params.set_from_wire(message.param_id, message.param_value, message.param_type)
        self._send_param(message.param_id, self._outbox.answer_time_s(now_s))

    def _send_param(self, name: str, due_s: float) -> None:
        value, kind, index = self._vehicle.params.wire_value(name)
        count = len(self._vehicle.params)
        value_message = mavlink.MAVLink_param_value_message(name.encode(), value, kind, count, index)
        self._outbox.put(value_message, due_s)
