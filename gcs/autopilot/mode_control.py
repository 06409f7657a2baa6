"""The two mode changes the follow function makes itself: into external control, and into hold.

A mode is believed only when telemetry shows it: ACCEPTED can mean that nothing happened.
"""

from __future__ import annotations

import asyncio
from functools import partial

from control.types import VehicleMode, VehicleState
from gcs import codec
from gcs.clock import Clock
from gcs.errors import VehicleError
from gcs.framing import dialect
from gcs.telemetry import Telemetry
from gcs.wire import STALE_S, Wire

CONFIRM_S = 1.5
_HOLD_RETRY_S = 0.5
_HOLD_TRIES = 3
_LOOK_S = 0.01  # time for the loop to read what waits in the socket
_REASON_S = 0.2  # a refusal's text may follow its answer


class ModeControl:
    """Commands of the flight in progress; arming and the like are in `actions`."""

    def __init__(self, wire: Wire, telemetry: Telemetry, clock: Clock) -> None:
        self._wire = wire
        self._telemetry = telemetry
        self._clock = clock

    def now_s(self) -> float:
        """The time to give as `asked_t_s`."""
        return self._clock.now_s()

    async def enter_external(self, asked_t_s: float | None = None) -> None:
        """Ask for OFFBOARD or GUIDED once and wait until it is seen, at most 1.5 s; VehicleError says why not.

        PX4 accepts only while setpoints arrive. Never repeated, and never asked for later than 0.1 s after
        asked_t_s: by then a pilot may have taken over.
        """
        t_start_s = self._clock.now_s()
        if not self._send(VehicleMode.EXTERNAL, t_made_s=t_start_s if asked_t_s is None else asked_t_s):
            late = asked_t_s is not None and t_start_s - asked_t_s > STALE_S
            why = "this computer stalled" if late else f"nothing can be sent to {self._wire.url}"
            raise VehicleError(f"external control was not asked for: {why}")
        if await self._telemetry.wait_for(
            lambda state: _seen_since(state, VehicleMode.EXTERNAL, t_start_s) or self._refused(t_start_s), CONFIRM_S
        ) and not self._refused(t_start_s):
            return
        await asyncio.sleep(_REASON_S)
        raise VehicleError(f"{self._telemetry.vehicle} refused external control: {self.reason(t_start_s)}")

    async def hold(self, asked_t_s: float | None = None) -> VehicleMode:
        """Command HOLD (BRAKE on ArduCopter) and wait for it; returns the mode the vehicle is in then.

        Repeated every 0.5 s, three times in all, but only while the vehicle still obeys us: any other mode means
        that the pilot or a failsafe has it, which is returned and not fought. VehicleError if it stays with us.
        Started late, after a stall, it looks first at what has come meanwhile.
        """
        t_start_s = self._clock.now_s()
        if asked_t_s is not None and t_start_s - asked_t_s > STALE_S:
            await asyncio.sleep(_LOOK_S)
            if _left_us(self._telemetry.vehicle_state(), asked_t_s):
                return self._telemetry.vehicle_state().mode
        for attempt in range(_HOLD_TRIES):
            t_sent_s = self._clock.now_s()
            self._send(VehicleMode.HOLD, attempt)
            if await self._telemetry.wait_for(partial(_left_us, t_s=t_sent_s), _HOLD_RETRY_S):
                return self._telemetry.vehicle_state().mode
        raise VehicleError(f"{self._telemetry.vehicle} does not hold: {self.reason(t_start_s)}")

    def _send(self, mode: VehicleMode, confirmation: int = 0, t_made_s: float | None = None) -> bool:
        armed = self._telemetry.vehicle_state().armed
        message = codec.set_mode(self._telemetry.vehicle, mode, armed, confirmation)
        return self._wire.send_message(message, t_made_s)

    def _refused(self, t_start_s: float) -> bool:
        ack = self._telemetry.ack_since(t_start_s, dialect.MAV_CMD_DO_SET_MODE)
        return ack is not None and ack.result not in (
            dialect.MAV_RESULT_ACCEPTED,
            dialect.MAV_RESULT_IN_PROGRESS,
        )

    def reason(self, t_start_s: float) -> str:
        """Answer, texts and mode since t_start_s in one line."""
        ack = self._telemetry.ack_since(t_start_s, dialect.MAV_CMD_DO_SET_MODE)
        parts = [ack.result_name if ack is not None else "no answer"]
        parts += [f"“{text.text}”" for text in self._telemetry.texts_since(t_start_s)[-2:]]
        parts.append(f"its mode is {self._telemetry.vehicle_state().mode.value}")
        return ", ".join(parts)


def _seen_since(state: VehicleState, mode: VehicleMode, t_s: float) -> bool:
    return state.mode is mode and state.mode_t_s is not None and state.mode_t_s > t_s


def _left_us(state: VehicleState, t_s: float) -> bool:
    return state.mode is not VehicleMode.EXTERNAL and state.mode_t_s is not None and state.mode_t_s > t_s
