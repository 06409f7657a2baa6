"""A point mass in wind, flown at a fence by requests that want out; shares no geometry with control/.

Vehicles as measured: PX4 with dead time and lag, ArduCopter with limits on acceleration and jerk. Wind pushes
the velocity off what was commanded, in gusts and in noise, and the vehicle's own loop takes it back. Telemetry is
two ticks old. A flight ends where what the state machine released has come to a stand.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from control.engagement import Action, Engagement, Inputs, State
from control.gate import Limits, Setpoint, gate
from control.gate_limits import outside
from control.types import VehicleMode, VehicleState, VelocityRequest

TICK_S = 0.05
STEP_S = 0.01
LATE_TICKS = 2
STANDING_MPS = 0.1
Pair = tuple[float, float]
Pilot = Callable[[float, Pair], Pair]  # time and place to the wanted velocity


@dataclass(frozen=True)
class Model:
    """The velocity loop: what shapes the command, dead time, lag; and what wind does to it.

    gust_mps: what one gust, some seconds after the one before, knocks the velocity off by, to be taken back with
    the time constant recovery_s; noise_mps: rms.
    """

    dead_s: float
    tau_s: float
    acceleration_mps2: float
    jerk_mps3: float
    gust_mps: float = 1.0
    noise_mps: float = 0.2
    calm_s: float = 3.0  # between gusts at least, on average one more second
    recovery_s: float = 0.6


PX4 = Model(0.20, 0.48, 9.0, 900.0)
ARDUCOPTER = Model(0.07, 0.10, 2.75, 5.6)  # 0 to 3 m/s in t10 0.47, t63 1.10, t90 1.74 s


class Body:
    """What flies: horizontal velocity under a command, and under wind."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.line = deque([0j] * round(model.dead_s / STEP_S))  # north + j east
        self.shaped = self.acceleration = self.velocity = self.pushed = 0j

    def step(self, command: Pair, push: Pair, noise: Pair) -> Pair:
        """STEP_S further; the velocity (m/s)."""
        model = self.model
        self._shape(complex(*command))
        self.line.append(self.shaped)
        self.velocity += (self.line.popleft() - self.velocity) * (1 - math.exp(-STEP_S / model.tau_s))
        keep = math.exp(-STEP_S / model.recovery_s)
        blown = complex(*push) + complex(*noise) * model.noise_mps * math.sqrt(1 - keep**2)
        self.pushed = self.pushed * keep + blown
        moved = self.velocity + self.pushed
        return moved.real, moved.imag

    def _shape(self, command: complex) -> None:
        """As ArduPilot does: as quick as jerk and acceleration allow without going past the command."""
        jerk, most = self.model.jerk_mps3, self.model.acceleration_mps2
        missing, gain = command - self.shaped, min(jerk / most, 1 / STEP_S)
        error, near = abs(missing), jerk / gain**2
        wanted = min(error * gain if error < near else math.sqrt(2 * jerk * (error - near / 2)), most)
        change = missing / max(error, 1e-9) * wanted - self.acceleration
        self.acceleration += change * min(1.0, jerk * STEP_S / max(abs(change), 1e-9))
        self.shaped += self.acceleration * STEP_S


@dataclass
class Flown:
    """What came of it. beyond_m: furthest outside the fence, below 0 if never. moved_after: setpoints after release."""

    beyond_m: float = -math.inf
    released_s: float | None = None
    moved_after: int = 0
    moving: int = 0
    path_m: float = 0.0


def fly(
    limits: Limits, start: Pair, pilot: Pilot, model: Model, beyond_m: Callable[[Pair], float], *, seed: int, s: float
) -> Flown:
    """One follow from start, with the real state machine and gate."""
    rng, flown, engagement = random.Random(seed), Flown(), Engagement()
    body, place = Body(model), start
    seen = deque([(start, (0.0, 0.0))] * (LATE_TICKS + 1), maxlen=LATE_TICKS + 1)
    velocity = (0.0, 0.0)
    previous: Setpoint | None = None
    gust_s = 0.0
    for tick in range(round(s / TICK_S)):
        now_s = 100.0 + tick * TICK_S
        seen.append((place, velocity))
        mode = VehicleMode.EXTERNAL if flown.released_s is None and tick > 2 else VehicleMode.HOLD
        inputs = healthy_inputs(now_s, *seen[0], limits, mode=mode, confirm=tick == 2)
        output = engagement.update(now_s, inputs)
        wanted = pilot(now_s, seen[0][0]) if output.action is Action.SEND_REQUEST else (0.0, 0.0)
        silent = output.action in (Action.NONE, Action.SILENCE)
        request = None if silent else VelocityRequest(now_s, (*wanted, 0.0), 0.0)
        previous, _ = gate(request, inputs.vehicle, now_s, previous, limits)
        sent = previous.velocity_ned_mps[:2] if previous is not None else (0.0, 0.0)
        if output.state is State.RELEASED and flown.released_s is None:
            flown.released_s = now_s
        if flown.released_s is not None and abs(body.velocity) < STANDING_MPS:
            return flown  # from here on it is the autopilot that holds its place against the wind
        flown.moving += any(sent)
        flown.moved_after += flown.released_s is not None and any(sent)
        gust = _gust(rng, model) if now_s > gust_s else (0.0, 0.0)
        gust_s = now_s + model.calm_s if any(gust) else gust_s
        for step in range(round(TICK_S / STEP_S)):
            command = sent if flown.released_s is None else (0.0, 0.0)
            push = gust if step == 0 else (0.0, 0.0)
            velocity = body.step(command, push, (rng.gauss(0, 1), rng.gauss(0, 1)))
            place = place[0] + velocity[0] * STEP_S, place[1] + velocity[1] * STEP_S
            flown.path_m += math.hypot(*velocity) * STEP_S
            flown.beyond_m = max(flown.beyond_m, beyond_m(place))
    return flown


def _gust(rng: random.Random, model: Model) -> Pair:
    if rng.random() > TICK_S:
        return 0.0, 0.0
    angle = rng.uniform(0, 2 * math.pi)
    return model.gust_mps * math.cos(angle), model.gust_mps * math.sin(angle)


def healthy_inputs(
    now_s: float,
    place: Pair,
    velocity: Pair = (0.0, 0.0),
    limits: Limits | None = None,
    *,
    mode: VehicleMode = VehicleMode.EXTERNAL,
    confirm: bool = False,
) -> Inputs:
    """Everything green but, perhaps, the place."""
    vehicle = VehicleState(
        heartbeat_t_s=now_s, mode=mode, mode_t_s=now_s, armed=True, in_air=True, attitude_t_s=now_s,
        position_t_s=now_s, position_ned_m=(*place, -20.0), velocity_ned_mps=(*velocity, 0.0), height_m=20.0,
        battery_frac=0.8,
    )  # fmt: skip
    return Inputs(
        vehicle=vehicle, frame_t_s=now_s, selected=True, measured_t_s=now_s, confidence=0.9, latency_s=0.15,
        attitude_rate_hz=50.0, request_t_s=now_s, confirm=confirm,
        outside_fence=outside(vehicle.position_ned_m, 20.0, limits or Limits()),
    )  # fmt: skip


def beyond_polygon(corners: tuple[Pair, ...]) -> Callable[[Pair], float]:
    """How far outside (m) a place is: below 0 inside. Told by winding number and by distance to each side."""
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))

    def beyond(place: Pair) -> float:
        turned, nearest = 0.0, math.inf
        for a, b in sides:
            ax, ay, bx, by = a[0] - place[0], a[1] - place[1], b[0] - place[0], b[1] - place[1]
            turned += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
            dx, dy = bx - ax, by - ay
            k = min(max(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0.0), 1.0)
            nearest = min(nearest, math.hypot(ax + k * dx, ay + k * dy))
        return -nearest if abs(turned) > math.pi else nearest

    return beyond


def beyond_circle(north: float, east: float, radius: float) -> Callable[[Pair], float]:
    """The same for a circle."""
    return lambda place: math.hypot(place[0] - north, place[1] - east) - radius
