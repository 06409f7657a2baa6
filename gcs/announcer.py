"""What a flight says aloud: the vehicle's texts, changes of state, warnings; each once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from control.causes import Cause
from control.engagement import State
from gcs.flight_control import Tick
from gcs.telemetry import Telemetry

_LOUD: Final = 4  # MAV_SEVERITY_WARNING and worse
_QUIET_S: Final = 10.0  # a warning that was away for so long is said again


class Announcer:
    """Give it every tick."""

    def __init__(self, telemetry: Telemetry, say: Callable[[str], None], now_s: float) -> None:
        self._telemetry = telemetry
        self._say = say
        self._texts_from_s = now_s
        self._said: tuple[State, tuple[Cause, ...]] | None = None
        self._warned_s: dict[Cause, float] = {}

    def ticked(self, tick: Tick) -> None:
        """Say what is new."""
        for text in self._telemetry.texts_since(self._texts_from_s, _LOUD):
            self._texts_from_s = math.nextafter(text.t_s, math.inf)
            self._say(f"vehicle: {text.text}")
        for cause in tick.output.warnings:
            if tick.t_s - self._warned_s.get(cause, -math.inf) > _QUIET_S:
                self._say(f"WARNING: {cause.value}")
            self._warned_s[cause] = tick.t_s
        state, reasons = tick.output.state, tick.output.reasons
        if self._said != (state, reasons):
            self._said = (state, reasons)
            why = "; ".join(cause.value for cause in reasons)
            self._say(f"{state.value.upper()}: {why}" if why else state.value.upper())
