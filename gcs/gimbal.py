"""The camera's gimbal by the Gimbal v2 protocol: found, listened to, controlled while a follow lasts, given back.

MAVSDK could manage a gimbal too, but its threads run in a time of their own: a flight could neither be flown in
simulated time nor again from its log. So these are messages of our own, on the one wire.

A rate stays in force at the gimbal until it is replaced. Every end of a follow therefore sends zero rates several
times before control is given back, and a program that finds itself in control when it starts does the same: one
before it has died in flight. Who takes control from us keeps it until the operator confirms another follow.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from enum import Enum
from typing import Final

from control.attitude import AttitudeBuffer, wrap_pi
from control.gate import TICK_S
from control.gimbal import GimbalRequest, GimbalState
from gcs import codec, gimbal_codec
from gcs.autopilot import Stream
from gcs.clock import Clock
from gcs.codec import VehicleId
from gcs.framing import Message, dialect
from gcs.gimbal_codec import Manager
from gcs.streams import StreamKeeper
from gcs.telemetry import Telemetry
from gcs.wire import COMPONENT_ID, SYSTEM_ID, Wire

STALE_S: Final = 0.5  # an attitude older than this is not used
_RATE_SPAN_S: Final = 0.06  # the turning rate is told over so long
_ATTITUDE_HZ, _STATUS_HZ = 50.0, 5.0
_ASK_S: Final = 1.0  # for a manager that has not answered yet
_RETRY_S: Final = 0.5
_TRIES: Final = 3
_ZEROS: Final = 3
_GRACE_S: Final = 0.5  # a status under way when control was granted still tells of the time before
_US: Final = (SYSTEM_ID, COMPONENT_ID)
_NOBODY: Final = (0, 0)
_LONGEST_LEAVE_TICKS: Final = 40


class Hold(Enum):
    """How far we are in control."""

    FREE = "not asked for"
    ASKED = "asked for"
    OURS = "ours"
    REFUSED = "refused"
    TAKEN = "taken by another"
    LEAVING = "being given back"


@dataclass(slots=True)
class _Asking:
    """One exchange with the manager: when and how often it was tried, zeros still to be sent before."""

    t_s: float
    tries: int = 0
    zeros: int = 0


class Gimbal:
    """Call `step` with every tick. `attitude`: the camera's, NED, as `Telemetry.attitude` is the vehicle's."""

    def __init__(self, wire: Wire, clock: Clock, telemetry: Telemetry, device_id: int | None) -> None:
        self.attitude = AttitudeBuffer(max_gap_s=STALE_S)
        self.manager: Manager | None = None
        self.hold = Hold.FREE
        self._wire, self._clock, self._telemetry = wire, clock, telemetry
        self._vehicle_attitude = telemetry.attitude
        self._device_id = device_id
        self._keeper = StreamKeeper(
            (Stream(gimbal_codec.ATTITUDE, _ATTITUDE_HZ), Stream(gimbal_codec.STATUS, _STATUS_HZ))
        )
        self._primary: tuple[int, int] | None = None
        self._granted_s = 0.0
        self._asked_information_s: float | None = None
        self._everybody = False
        self._asking = _Asking(0.0)
        self._unsubscribe = wire.subscribe(self.on_message)

    # -- listening ----------------------------------------------------------------------------------------

    def on_message(self, message: Message, t_s: float) -> None:
        """A valid message of anybody arrived at t_s."""
        vehicle = self._wire.vehicle
        if vehicle is None or message.get_srcSystem() != vehicle.system_id:
            return
        match message.get_type():
            case "GIMBAL_MANAGER_INFORMATION" if self.manager is None and self._is_wanted(message.gimbal_device_id):
                self.manager = gimbal_codec.manager_of(message, vehicle)
            case "GIMBAL_DEVICE_ATTITUDE_STATUS" if self._is_device(message):
                self._keeper.heard(message.get_msgId(), t_s)
                self._turned(message, t_s - (self._telemetry.round_trip.one_way_s or 0.0))
            case "GIMBAL_MANAGER_STATUS" if self._is_manager(message) and self._is_ours(message.gimbal_device_id):
                self._keeper.heard(message.get_msgId(), t_s)
                self._told((message.primary_control_sysid, message.primary_control_compid), t_s)
            case "COMMAND_ACK" if self._is_manager(message) and message.command == gimbal_codec.CONFIGURE:
                if (message.target_system, message.target_component) in (_US, _NOBODY):
                    self._answered(message.result, t_s)

    def _is_wanted(self, device_id: int) -> bool:
        return device_id > 0 and self._device_id in (None, device_id)

    def _is_ours(self, device_id: int) -> bool:
        return self.manager is not None and device_id == self.manager.device_id

    def _is_manager(self, message: Message) -> bool:
        return self.manager is not None and message.get_srcComponent() == self.manager.vehicle.component_id

    def _is_device(self, message: Message) -> bool:
        if self.manager is None or message.get_srcComponent() != self.manager.device.component_id:
            return False
        return message.gimbal_device_id in (0, self.manager.device_id)

    def _turned(self, message: Message, t_s: float) -> None:
        """t_s: when it was sent, as near as the round trip tells; the vehicle's attitudes bear the same times."""
        seen = gimbal_codec.attitude(message)
        if seen is None:
            return
        yaw_rad = seen.yaw_rad
        if not seen.from_north:
            vehicle = self._vehicle_attitude.at(t_s)
            if vehicle is None:
                return
            yaw_rad += vehicle[2]
        self.attitude.add(t_s, seen.roll_rad, seen.pitch_rad, wrap_pi(yaw_rad))

    def _told(self, primary: tuple[int, int], t_s: float) -> None:
        """GIMBAL_MANAGER_STATUS: who is in control."""
        self._primary = primary
        if self.hold is Hold.ASKED and primary == _US:
            self._grant(t_s)
        elif self.hold is Hold.OURS and primary != _US and t_s - self._granted_s > _GRACE_S:
            self.hold = Hold.TAKEN
        elif self.hold is Hold.LEAVING and primary not in (_US, _NOBODY):
            self.hold = Hold.FREE

    def _answered(self, result: int, t_s: float) -> None:
        if result == dialect.MAV_RESULT_IN_PROGRESS:
            return
        accepted = result == dialect.MAV_RESULT_ACCEPTED
        if self.hold is Hold.ASKED:
            self._grant(t_s) if accepted else self._end(Hold.REFUSED)
        elif self.hold is Hold.LEAVING and accepted and self._asking.tries:
            self._end(Hold.FREE)

    def _grant(self, t_s: float) -> None:
        self.hold, self._granted_s, self._primary = Hold.OURS, t_s, _US

    def _end(self, hold: Hold) -> None:
        self.hold = hold
        if hold is Hold.FREE and self._primary == _US:
            self._primary = None  # until told again

    # -- what others get to see -----------------------------------------------------------------------------

    def state(self, now_s: float) -> GimbalState | None:
        """Where the camera looks; None where that is not known, or older than STALE_S."""
        t_s = self.attitude.newest_t_s
        if self.manager is None or t_s is None or now_s - t_s > STALE_S:
            return None
        newest, before = self.attitude.at(t_s), self.attitude.at(t_s - _RATE_SPAN_S)
        vehicle = self._vehicle_attitude.at(t_s)
        if newest is None or vehicle is None:
            return None
        pitch_rps, yaw_rps = (
            (0.0, 0.0) if before is None else (wrap_pi(newest[i] - before[i]) / _RATE_SPAN_S for i in (1, 2))
        )
        relative_rad = wrap_pi(newest[2] - vehicle[2])
        ours = self.hold is Hold.OURS
        return GimbalState(
            t_s, newest[1], newest[2], relative_rad, pitch_rps, yaw_rps, t_s - _RATE_SPAN_S / 2,
            self.manager.limits, ours,
        )  # fmt: skip

    def warnings(self, now_s: float) -> tuple[str, ...]:
        """What keeps the gimbal from being used, for the operator."""
        if self.manager is None:
            return ("no gimbal manager answers: nothing can be followed",)
        found = []
        newest_s = self.attitude.newest_t_s
        if newest_s is None or now_s - newest_s > STALE_S:
            found.append("the gimbal's attitude is not heard: nothing can be followed")
        if self.hold is Hold.REFUSED:
            found.append("control of the gimbal was refused")
        if self.hold is Hold.TAKEN:
            who = "nobody" if self._primary in (None, _NOBODY) else "system {}, component {}".format(*self._primary)
            found.append(f"control of the gimbal was taken from us: it is with {who}")
        return tuple(found)

    # -- speaking -----------------------------------------------------------------------------------------

    def step(self, now_s: float, request: GimbalRequest | None) -> None:
        """One tick: request is what the follow wants, None while there is none."""
        if self._wire.vehicle is None:
            return
        if self.manager is None:
            self._look_for(self._wire.vehicle, now_s)
            return
        for stream in self._keeper.due(now_s):
            at = self.manager.device if stream.message_id == gimbal_codec.ATTITUDE else self.manager.vehicle
            self._wire.send_message(codec.set_message_interval(at, stream.message_id, stream.rate_hz))
        if request is not None:
            self._follow(self.manager, now_s, request)
        else:
            self._leave(self.manager, now_s)

    def _look_for(self, vehicle: VehicleId, now_s: float) -> None:
        """Ask the autopilot, and every other time whoever else there is aboard."""
        if self._asked_information_s is not None and now_s - self._asked_information_s < _ASK_S:
            return
        self._asked_information_s = now_s
        to = VehicleId(vehicle.system_id, 0, vehicle.autopilot) if self._everybody else vehicle
        self._everybody = not self._everybody
        self._wire.send_message(gimbal_codec.request_information(to))

    def _follow(self, manager: Manager, now_s: float, request: GimbalRequest) -> None:
        if self.hold is Hold.OURS:
            self._wire.send_message(gimbal_codec.rates(request, manager), now_s)
            return
        if self.hold in (Hold.FREE, Hold.LEAVING):
            self.hold, self._asking = Hold.ASKED, _Asking(now_s - _RETRY_S)
        if self.hold is Hold.ASKED and now_s - self._asking.t_s >= _RETRY_S - TICK_S / 2:
            if self._asking.tries >= _TRIES:
                self.hold = Hold.REFUSED
                return
            self._asking = _Asking(now_s, self._asking.tries + 1)
            self._wire.send_message(gimbal_codec.take_control(manager), now_s)

    def _leave(self, manager: Manager, now_s: float) -> None:
        if self.hold in (Hold.TAKEN, Hold.REFUSED):
            self.hold = Hold.FREE
        elif self.hold is Hold.OURS or (self.hold is Hold.FREE and self._primary == _US):
            self.hold, self._asking = Hold.LEAVING, _Asking(now_s, zeros=_ZEROS)
        elif self.hold is Hold.ASKED:  # the answer may still come
            self.hold, self._asking = Hold.LEAVING, _Asking(now_s)
        if self.hold is not Hold.LEAVING:
            return
        asking = self._asking
        if asking.zeros:
            asking.zeros -= 1
            self._wire.send_message(gimbal_codec.rates(GimbalRequest(now_s), manager))
            if asking.zeros:
                return
        elif asking.tries and now_s - asking.t_s < _RETRY_S - TICK_S / 2:
            return
        elif asking.tries >= _TRIES:
            self._end(Hold.FREE)
            return
        elif asking.tries and self._primary == _US:
            self._wire.send_message(gimbal_codec.rates(GimbalRequest(now_s), manager))
        asking.t_s, asking.tries = now_s, asking.tries + 1
        self._wire.send_message(gimbal_codec.give_back(manager))

    async def leave(self) -> None:
        """The end of the program: zero rates and control given back, tried for two seconds at most."""
        for _ in range(_LONGEST_LEAVE_TICKS):
            self.step(self._clock.now_s(), None)
            if self.hold is Hold.FREE:
                return
            await asyncio.sleep(TICK_S)

    def close(self) -> None:
        """Stop listening."""
        self._unsubscribe()
