"""What the operator orders outside following: arm, take off, hold, return, land, parameters. By MAVSDK."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from mavsdk import MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.param import Param, ParamError, ParamResult

from control.types import VehicleMode, VehicleState
from gcs.autopilot.mavsdk_link import MavsdkLink
from gcs.clock import Clock
from gcs.errors import VehicleError
from gcs.telemetry import Telemetry
from gcs.wire import Wire

_FIND_S = 5.0
_CONFIRM_S = 3.0
_REASON_S = 0.2  # a refusal's text may follow its answer
_CLIMB_SLOWEST_MPS = 0.3


class VehicleActions:
    """Orders to one vehicle; each returns when telemetry confirms it, or raises VehicleError with the reason."""

    def __init__(self, link: MavsdkLink, system: Any, telemetry: Telemetry, clock: Clock) -> None:
        self._link = link
        self._telemetry = telemetry
        self._clock = clock
        self._action: Any = Action(system)
        self._param: Any = Param(system)
        self._params_one_by_one = asyncio.Lock()

    @classmethod
    async def attach(cls, wire: Wire, telemetry: Telemetry, clock: Clock) -> VehicleActions:
        """Start MAVSDK on the wire, whose vehicle must have been heard; VehicleError if it does not see it."""
        link = MavsdkLink(wire, clock)
        try:
            system = await link.system(_FIND_S)
            return cls(link, system, telemetry, clock)
        except BaseException:
            await link.close()
            raise

    async def wait_ready(self, timeout_s: float) -> None:
        """Until the vehicle may be armed: its own checks pass, attitude, position and home are known."""
        t_start_s = self._clock.now_s()
        if not await self._telemetry.wait_for(lambda _: not self._not_ready(), timeout_s):
            lacking = ", ".join(self._not_ready()) or "only just now"
            raise VehicleError(
                f"{self._telemetry.vehicle} not ready within {timeout_s:g} s: {lacking}{self._texts(t_start_s)}"
            )

    def _not_ready(self) -> list[str]:
        state, telemetry = self._telemetry.vehicle_state(), self._telemetry
        lacking = {
            "no attitude": state.attitude_t_s is None,
            "no position": state.position_t_s is None,
            "no home position": telemetry.home is None,
            "its pre-arm checks fail": telemetry.prearm_ok is False and not state.armed,
            "a failsafe is active": state.failsafe,
        }
        return [reason for reason, applies in lacking.items() if applies]

    async def arm(self) -> None:
        """Arm; motors turn."""
        await self._order("arm", self._action.arm, lambda state: state.armed)

    async def takeoff(self, height_m: float) -> None:
        """Take off and wait until 90 % of height_m (above home) is reached and the climb is over.

        PX4 keeps the height as its parameter MIS_TAKEOFF_ALT.
        """
        if not (math.isfinite(height_m) and 1.0 <= height_m <= 120.0):
            raise VehicleError(f"take-off height must be from 1 to 120 m, not {height_m:g}")
        await self._run("set the take-off height", self._action.set_takeoff_altitude, float(height_m))
        await self._order("take off", self._action.takeoff, lambda state: state.in_air)
        timeout_s = 10.0 + height_m / _CLIMB_SLOWEST_MPS

        def has_climbed(state: VehicleState) -> bool:
            return state.height_m >= 0.9 * height_m and state.mode is not VehicleMode.TAKEOFF

        t_start_s = self._clock.now_s()
        if not await self._telemetry.wait_for(has_climbed, timeout_s):
            state = self._telemetry.vehicle_state()
            raise VehicleError(
                f"take-off ended at {state.height_m:.1f} of {height_m:g} m in mode {state.mode.value}"
                f"{self._texts(t_start_s)}"
            )

    async def hold(self) -> None:
        """Stay here (PX4 hold, ArduCopter brake)."""
        await self._order("hold", self._action.hold, _in(VehicleMode.HOLD))

    async def return_to_launch(self) -> None:
        """Fly home and land there."""
        await self._order("return", self._action.return_to_launch, _in(VehicleMode.RETURN))

    async def land(self) -> None:
        """Land here; returns when the vehicle is in its landing mode."""
        await self._order("land", self._action.land, _in(VehicleMode.LAND))

    async def get_param(self, name: str) -> int | float:
        """A parameter of the vehicle, in its own type."""
        async with self._params_one_by_one:
            return await self._get_param(name)

    async def set_param(self, name: str, value: int | float) -> None:
        """Set a parameter in its own type and read it back; VehicleError if it does not stick."""
        async with self._params_one_by_one:
            if isinstance(await self._get_param(name), int):
                if not float(value).is_integer():
                    raise VehicleError(f"parameter {name} is an integer, {value:g} is not")
                await self._run(f"set {name}", self._param.set_param_int, name, int(value))
            else:
                await self._run(f"set {name}", self._param.set_param_float, name, float(value))
            now = await self._get_param(name)
        if not math.isclose(now, value, rel_tol=1e-6, abs_tol=1e-9):
            raise VehicleError(f"parameter {name} is still {now:g}, not {value:g}")

    async def _get_param(self, name: str) -> int | float:
        try:
            whole: int = await self._link.call(self._param.get_param_int, name)
            return whole
        except ParamError as error:
            if error.result != ParamResult.WRONG_TYPE:
                raise VehicleError(f"parameter {name}: {error.result.name}") from None
        value: float = await self._run(f"parameter {name}", self._param.get_param_float, name)
        return value

    async def close(self) -> None:
        """Let go of MAVSDK; nothing may be ordered afterwards."""
        await self._link.close()

    async def _order(self, what: str, call: Callable[[], Any], shown: Callable[[VehicleState], bool]) -> None:
        t_start_s = self._clock.now_s()
        await self._run(what, call)
        if not await self._telemetry.wait_for(shown, _CONFIRM_S):
            mode = self._telemetry.vehicle_state().mode.value
            raise VehicleError(
                f"{self._telemetry.vehicle} accepted “{what}” but does not do it: its mode is {mode}"
                f"{self._texts(t_start_s)}"
            )

    async def _run(self, what: str, call: Callable[..., Any], *args: Any) -> Any:
        t_start_s = self._clock.now_s()
        try:
            return await self._link.call(call, *args)
        except MavsdkError as error:
            result = getattr(error, "result", None)
            await asyncio.sleep(_REASON_S)
            raise VehicleError(
                f"{self._telemetry.vehicle} refused “{what}”: {getattr(result, 'name', error)}{self._texts(t_start_s)}"
            ) from None

    def _texts(self, t_start_s: float) -> str:
        texts = self._telemetry.texts_since(t_start_s)[-2:]
        return "".join(f", “{text.text}”" for text in texts)


def _in(mode: VehicleMode) -> Callable[[VehicleState], bool]:
    return lambda state: state.mode is mode
