"""What a dry run draws on its pictures."""

from __future__ import annotations

import math

from control.engagement import State
from gcs.dryrun.rehearsal import Tick, View
from gcs.hud import Overlay, Tone
from tracker.box import TrackResult


def overlay_of(result: TrackResult, view: View | None, tick: Tick | None, figures: str) -> Overlay:
    """The overlay after one frame; tick: the newest 20 Hz moment, figures: the last line of text."""
    state = tick.state if tick else State.SELECTED
    error_m = None
    if view is not None and view.distance_m is not None and view.standoff_m is not None:
        error_m = view.distance_m - view.standoff_m
    return Overlay(
        state=state.value.upper(),
        tone=tone_of(state),
        box=result.box,
        predicted=view.predicted if view else None,
        confidence=result.confidence,
        distance_m=view.distance_m if view else None,
        standoff_error_m=error_m,
        watermark="DRY RUN",
        lines=(_would_be_line(tick), figures),
    )


def tone_of(state: State) -> Tone:
    """How urgent a state looks on the picture."""
    match state:
        case State.FOLLOWING:
            return Tone.GOOD
        case State.COASTING:
            return Tone.CAUTION
        case State.LOST_HOLD | State.RELEASED | State.TAKEN_OVER | State.NO_VIDEO:
            return Tone.ALARM
        case State.IDLE | State.SELECTED:
            return Tone.CALM


def _would_be_line(tick: Tick | None) -> str:
    if tick is None or tick.would_be is None:
        return "would-be setpoint: none"
    north, east, down = tick.would_be.velocity_ned_mps
    yaw_dps = math.degrees(tick.would_be.yaw_rate_rps)
    return f"would-be  N {north:+.1f}  E {east:+.1f}  D {down:+.1f} m/s  yaw {yaw_dps:+.0f} deg/s"
