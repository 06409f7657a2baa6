"""Flights written down by hand, whose figures can be worked out on paper."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from control.causes import Cause
from control.engagement import Action, Inputs, Output, State
from control.latency import UNKNOWN
from control.modes import Confirmation, FollowMode
from control.types import BearingMeasurement, Reason, TargetState, VehicleMode, VehicleState, VelocityRequest
from gcs.framing import Encoder, dialect
from gcs.latency_budget import Budget
from gcs.recorder.events import FrameRecord
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.message_log import MessageLog
from gcs.tick import Tick
from tracker.box import Box, TrackResult

START_S = 1000.0
TICK_S = 0.05
HELD = Confirmation(FollowMode.FOLLOW, START_S, 0.0, 12.0, 12.0, 10.0, 8.0, (0.0, 0.0, -8.0))
TARGET = TargetState(START_S, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.9, START_S, 0)
BOX = Box(320.0, 240.0, 40.0, 30.0)


def write_log(folder: Path, entries: Iterable[tuple[float, object]]) -> Path:
    """messages.jsonl of these (t_s, event)."""
    folder.mkdir(exist_ok=True)
    log = MessageLog(folder / MESSAGES, wait_when_full=True)
    for t_s, event in entries:
        log.write(t_s, event)
    log.close()
    assert log.problem is None
    return folder


def tick(
    t_s: float,
    state: State,
    reasons: tuple[Cause, ...] = (),
    *,
    limited_by: tuple[str, ...] = (),
    gate: Reason = Reason.PASSED,
    north_m: float = 0.0,
    budget: Budget | None = None,
    has_vehicle: bool = True,
) -> Tick:
    """A decision; while following the target is 12 m to the north, to be kept at 10 m."""
    vehicle = VehicleState()
    if has_vehicle:
        vehicle = VehicleState(
            mode=VehicleMode.EXTERNAL, armed=True, attitude_t_s=t_s, position_t_s=t_s, height_m=8.0,
            position_ned_m=(north_m, 0.0, -8.0), battery_frac=0.75,
        )  # fmt: skip
    followed = state in (State.FOLLOWING, State.COASTING, State.LOST_HOLD)
    inputs = Inputs(vehicle=vehicle, selected=followed, latency_s=0.1)
    request = VelocityRequest(t_s, (1.0, 0.0, 0.0), 0.0, limited_by)
    return Tick(
        t_s, inputs, Output(state, reasons, Action.NONE), TARGET, request, None, gate, budget=budget,
        held=HELD if followed else None,
    )  # fmt: skip


def frame(t_s: float, azimuth_rad: float | None, confidence: float = 0.9, problem: str | None = None) -> FrameRecord:
    """A frame; azimuth_rad: of the target, None where it was not seen."""
    seen = azimuth_rad is not None
    measurement = BearingMeasurement(t_s, azimuth_rad, 0.0, 0.0, confidence) if azimuth_rad is not None else None
    result = TrackResult(BOX, 0.9, confidence, seen)
    return FrameRecord(
        t_s, t_s, t_s, 1, result, measurement, False, problem, 0.0, 0.0, UNKNOWN, predicted=BOX, told=None
    )


def ticks(begin_s: float, seconds: float, state: State, *reasons: Cause) -> list[tuple[float, object]]:
    """Decisions at 20 Hz from begin_s (after START_S) on."""
    first = round(begin_s / TICK_S)
    times_s = [START_S + (first + n) * TICK_S for n in range(round(seconds / TICK_S))]
    return [(t_s, tick(t_s, state, reasons)) for t_s in times_s]


def status_text(text: str) -> bytes:
    """A STATUSTEXT of the vehicle."""
    message = dialect.MAVLink_statustext_message(4, text.encode(), 0, 0)
    return Encoder(1, 1).encode(message)


def vehicle_frames(seconds: float) -> list[tuple[float, bytes]]:
    """What an ArduCopter says that flies 20 m to and fro, once a tenth of a second: (time, frame)."""
    encoder, said = Encoder(1, 1), list[tuple[float, bytes]]()
    for n in range(round(seconds * 10)):
        t_s, north_m = START_S + n / 10, 20 * math.cos(n / 50)
        lat, lon = round((47.0 + north_m / 111_194.9) * 1e7), round(8.0 * 1e7)
        messages = (
            dialect.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3),  # a quadrotor of ArduPilot, armed, LOITER
            dialect.MAVLink_global_position_int_message(n * 100, lat, lon, 500_000, 15_000, 0, 0, 0, 0),
            dialect.MAVLink_sys_status_message(0, 0, 0, 0, 12_000, 100, 90 - n // 10, 0, 0, 0, 0, 0, 0),
        )
        said += [(t_s, encoder.encode(message)) for message in messages]
    return said
