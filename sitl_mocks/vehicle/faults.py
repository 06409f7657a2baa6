"""What a test may break in the mock vehicle; every field can be set at any time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from sitl_mocks.vehicle.modes import Result


@dataclass(slots=True)
class Faults:
    """Link, autopilot, sensors, signing. Shares are of datagrams, 0 to 1; streams are message ids.

    refuse: a MAV_CMD to its result, None = no answer at all. accept_without_effect: MAV_CMDs that are acknowledged and
    not done. silent_parameters: names whose reads and sets go unanswered. dead_reckoning_s: how long position and
    velocity stay valid without GPS. estimator_flags: ESTIMATOR_STATUS.flags instead of the true ones.
    replay_frac, forge_frac: old frames of its own, and frames with its address and a wrong signature, come along too.
    unsigned_frac: sent unsigned although it has a key.
    """

    drop_uplink: float = 0.0
    drop_downlink: float = 0.0
    stopped_streams: set[int] = field(default_factory=set)
    nan_streams: set[int] = field(default_factory=set)
    stale_streams: set[int] = field(default_factory=set)  # the same contents, time stamp included, over and over
    refuse: dict[int, Result | None] = field(default_factory=dict)
    accept_without_effect: set[int] = field(default_factory=set)
    ack_delay_s: float = 0.0
    silent_parameters: set[str] = field(default_factory=set)
    frozen: bool = False  # the autopilot's process is stopped: datagrams wait in its socket
    gps_lost: bool = False
    dead_reckoning_s: float = 5.0
    estimator_flags: int | None = None
    battery_unknown: bool = False
    battery_fault: bool = False
    echo_offset_mps: float = 0.0  # POSITION_TARGET_LOCAL_NED is that much off, north
    replay_frac: float = 0.0
    forge_frac: float = 0.0
    unsigned_frac: float = 0.0


def without_numbers(message: Any) -> Any:
    """The message with NaN in all its floating-point fields."""
    for name in message.fieldnames:
        value = getattr(message, name)
        if isinstance(value, float):
            setattr(message, name, math.nan)
        elif isinstance(value, list) and value and isinstance(value[0], float):
            setattr(message, name, [math.nan] * len(value))
    return message
