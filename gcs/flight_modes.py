"""The mode changes a follow makes, each asked for once when the state machine wants it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Final, TypeAlias, assert_never

from control.engagement import Action
from control.types import VehicleMode
from gcs.autopilot.mode_control import ModeControl
from gcs.errors import VehicleError

Spawn: TypeAlias = Callable[[Coroutine[Any, Any, None]], "asyncio.Task[None]"]

_PRIMING_TICKS: Final = 2  # PX4 takes OFFBOARD only once a setpoint has arrived


class ModeSwitch:
    """Give it every tick's action; waiting for answers happens in tasks of its own."""

    def __init__(self, modes: ModeControl, say: Callable[[str], None]) -> None:
        self._modes = modes
        self._say = say
        self._engage_ticks = 0
        self._hold_asked = False
        self._entering: asyncio.Task[None] | None = None
        self._holding: asyncio.Task[None] | None = None

    def act(self, action: Action, mode: VehicleMode, spawn: Spawn) -> None:
        """What this tick asks for; mode: the vehicle's, as seen by telemetry."""
        self._engage_ticks = self._engage_ticks + 1 if action is Action.ENGAGE else 0
        match action:
            case Action.ENGAGE:
                if self._engage_ticks == _PRIMING_TICKS:
                    self._entering = spawn(self._enter(self._modes.now_s()))
            case Action.COMMAND_HOLD:
                self._stop_entering()
                running = self._holding is not None and not self._holding.done()
                if not running and (not self._hold_asked or mode is VehicleMode.EXTERNAL):
                    self._hold_asked = True
                    self._holding = spawn(self.hold(self._modes.now_s()))
            case Action.SILENCE:
                self._stop_entering()
                self._hold_asked = False
            case Action.NONE | Action.SEND_ZERO | Action.SEND_REQUEST:
                self._hold_asked = False
            case _:
                assert_never(action)

    def cancel(self) -> None:
        """Wait for no answer any longer."""
        self._stop_entering()
        if self._holding is not None:
            self._holding.cancel()

    def _stop_entering(self) -> None:
        """Its one command has left; only the waiting ends."""
        if self._entering is not None:
            self._entering.cancel()
            self._entering = None

    async def _enter(self, asked_t_s: float) -> None:
        try:
            await self._modes.enter_external(asked_t_s)
        except VehicleError as error:
            self._say(str(error))

    async def hold(self, asked_t_s: float | None = None) -> None:
        """Hold, repeated until it is seen; an alarm if it never is."""
        try:
            await self._modes.hold(asked_t_s)
        except VehicleError as error:
            self._say(f"ALARM: {error}; nothing more is sent, the vehicle's own time-out must stop it")
