"""An airframe from what its owner can measure: dead time and time constant of its answers to a step."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from gcs.errors import GcsError
from sitl_mocks.dynamics import ARDUPILOT, PX4, Airframe, Response
from sitl_mocks.vehicle import Personality

_TILT_S = 0.15  # a vehicle leans before it moves: of a measured answer so much is the lean,
_TORQUE_S = 0.03  # and so much the rotors' answer before it turns
_STEP_S, _LONGEST_S = 0.001, 10.0


class AirframeError(GcsError):
    """A response no vehicle has; the text says which."""


@dataclass(frozen=True, slots=True)
class StepResponse:
    """Answer to a step of velocity or yaw rate: dead_s of nothing, then first order with tau_s."""

    dead_s: float
    tau_s: float

    @classmethod
    def parse(cls, text: str, name: str) -> StepResponse:
        """From DEAD,TAU in s. Raises AirframeError."""
        match = re.fullmatch(r"\s*([\d.]+)\s*,\s*([\d.]+)\s*", text)
        try:
            dead_s, tau_s = (float(part) for part in match.groups()) if match else (math.nan, math.nan)
        except ValueError:
            dead_s = tau_s = math.nan
        if not (0.0 <= dead_s <= 1.0 and 0.05 <= tau_s <= 3.0):
            raise AirframeError(f"{name}: {text!r} is not DEAD,TAU in seconds, 0 to 1 and 0.05 to 3, as in 0.20,0.48")
        return cls(dead_s, tau_s)


def airframe(
    personality: Personality, velocity: StepResponse | None = None, yaw_rate: StepResponse | None = None
) -> Airframe:
    """The autopilot's own airframe as measured in simulation, with the responses that were measured on yours."""
    frame = PX4 if personality is Personality.PX4 else ARDUPILOT
    if velocity is not None:
        frame = replace(frame, horizontal=_second_order(velocity, _TILT_S, 9.0, 37.0))
    if yaw_rate is not None:
        frame = replace(frame, yaw=_second_order(yaw_rate, _TORQUE_S, math.radians(320), math.inf))
    return frame


def _second_order(response: StepResponse, quick_s: float, accel_max: float, jerk_max: float) -> Response:
    """The same delay in all as dead time and first order, but with an acceleration that does not jump."""
    quick_s = min(quick_s, response.tau_s / 2)
    slow_s = max(response.tau_s - quick_s / 4, quick_s)
    dead_s = max(response.dead_s + response.tau_s - slow_s - quick_s, 0.0)
    a, b = 1 / quick_s, 1 / slow_s
    return Response(dead_s, a * b / (a + b), a + b, accel_max, jerk_max)


def measured(frame: Airframe, *, yaw: bool) -> StepResponse:
    """What a step test on it would find: t63 is their sum, t28 tells them apart (Broida's method)."""
    response = frame.yaw if yaw else frame.horizontal
    step = math.radians(30) if yaw else 3.0
    value = acceleration = 0.0
    times: list[float] = []
    for tick in range(int(_LONGEST_S / _STEP_S)):
        t_s = tick * _STEP_S
        command = step if t_s >= response.delay_s else 0.0
        wanted = min(response.gain_ps * (command - value), response.accel_max)
        jerk = response.accel_gain_ps * (wanted - acceleration)
        acceleration += min(max(jerk, -response.jerk_max), response.jerk_max) * _STEP_S
        value += acceleration * _STEP_S
        if value >= step * (0.283, 0.632)[min(len(times), 1)]:
            times.append(t_s)
        if len(times) == 2:
            break
    t28_s, t63_s = times
    tau_s = 1.5 * (t63_s - t28_s)
    return StepResponse(max(t63_s - tau_s, 0.0), tau_s)
