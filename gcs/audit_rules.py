"""What the vehicle's parameters must be before anybody is followed: a table per autopilot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

STATION_SYSTEM_ID: Final = 255  # gcs.wire.SYSTEM_ID; kept apart so that configurations load without a wire
Test: TypeAlias = Callable[[float], bool]


@dataclass(frozen=True, slots=True)
class Rule:
    """One parameter. names: the newest firmware's name first. wanted: for people; set_to: a value that is fine.

    What is neither `fine` nor `tolerable` is unsafe, and so is a value that cannot be read. together: judges instead
    of `fine` where one value tells too little.
    """

    names: tuple[str, ...]
    wanted: str
    set_to: float
    why: str
    fine: Test
    tolerable: Test = lambda value: False
    together: Callable[[Mapping[str, float]], bool] | None = None


def anything(value: float) -> bool:
    """Any value will do."""
    return True


def among(*values: float) -> Test:
    """One of these."""
    return lambda value: value in values


def within(low: float, high: float) -> Test:
    """From low to high."""
    return lambda value: low <= value <= high


def has_bit(*bits: int) -> Test:
    """One of these bits is set."""
    return lambda value: any(int(value) >> bit & 1 for bit in bits)


def lacks_bit(bit: int) -> Test:
    """This bit is clear."""
    return lambda value: not int(value) >> bit & 1


PX4: Final = (
    Rule(
        ("COM_OF_LOSS_T",), "0.2 to 0.5 s", 0.5,
        "how long it flies on at its last velocity when this program has died",
        within(0.2, 0.5), within(0.0, 1.0),
    ),
    Rule(
        ("COM_OBL_RC_ACT",), "5, Hold", 5,
        "what it does then: in 0 to 2 without sticks it drifts on and sinks until it lands; 3 returns, 4 lands",
        among(5), among(3, 4),
    ),
    Rule(
        ("COM_RC_OVERRIDE",), "bit 1 set (3)", 3,
        "otherwise the sticks, which need a radio control, do not take over in Offboard",
        has_bit(1),
    ),
    Rule(
        ("GF_ACTION",), "2, Hold (or 3 Return, 5 Land)", 2,
        "0 and 1 only watch while it flies out of its fence; 4 stops the motors",
        among(2, 3, 5),
    ),
    Rule(
        ("GF_MAX_HOR_DIST",), "your field's radius, 10 to 1000 m", 500,
        "0 is no fence; the vehicle's own is the one that holds when ours is wrong",
        within(10, 1000), within(1, math.inf),
    ),
    # Setpoints that end are found by COM_OF_LOSS_T, so this guards what comes after a follow. 5 and 6 cut the motors.
    Rule(
        ("NAV_DLL_ACT",), "2, Return (or 3 Land)", 2,
        "0 never misses a ground station that is gone; 1 goes back to Offboard by itself when it returns",
        among(2, 3), among(0, 1),
    ),
    Rule(
        ("COM_DL_LOSS_T",), "5 to 10 s", 10,
        "how long a ground station may be gone before NAV_DLL_ACT",
        within(5, 10), anything,
    ),
    Rule(
        ("COM_RCL_EXCEPT",), "bit 2 clear", 0,
        "with it the loss of the pilot's radio control goes unnoticed in Offboard",
        lacks_bit(2), anything,
    ),
    Rule(
        ("COM_RC_LOSS_T",), "at most 1 s", 0.5,
        "how long the pilot's radio control may be gone unnoticed",
        within(0, 1), anything,
    ),
    Rule(
        ("COM_LOW_BAT_ACT",), "2 or 3, Land or Return in time", 3,
        "0 only warns: following ends with the battery",
        among(2, 3), anything,
    ),
)  # fmt: skip

ARDUCOPTER: Final = (
    Rule(
        ("GUID_TIMEOUT",), "0.2 to 1 s", 1,
        "how long it flies on at its last velocity when this program has died; 3 by default",
        within(0.2, 1.0), within(0.1, 2.0),
    ),
    # Guided itself holds after GUID_TIMEOUT but stays Guided, and obeys whoever speaks next.
    Rule(
        ("FS_GCS_ENABLE",), "1, return (or 5, land)", 1,
        "0 leaves it in Guided for ever when the ground station is gone, obeying whoever speaks next",
        within(1, 7),
    ),
    Rule(
        ("MAV_GCS_SYSID", "SYSID_MYGCS"), f"{STATION_SYSTEM_ID}, this station", STATION_SYSTEM_ID,
        "only heartbeats of this system count for FS_GCS_ENABLE",
        among(STATION_SYSTEM_ID),
    ),
    Rule(
        ("FENCE_ENABLE",), "1", 1,
        "the vehicle's own fence is the one that holds when ours is wrong",
        among(1),
    ),
    Rule(
        ("FENCE_TYPE",), "bit 1 (circle) or 2 (polygon) set (7)", 7,
        "otherwise its fence has no sides",
        has_bit(1, 2),
    ),
    Rule(
        ("FENCE_ACTION",), "1, return or land (or 2 to 5)", 1,
        "0 only reports while it flies out of its fence",
        within(1, 5),
    ),
    Rule(
        ("FENCE_RADIUS",), "your field's radius, 30 to 1000 m", 300,
        "further out nobody sees what it does",
        within(30, 1000), anything,
    ),
    Rule(
        ("FLTMODE_CH",), "the mode switch's channel, 5 to 16", 5,
        "0 takes the mode switch, which always wins, away from the pilot",
        within(1, 16),
    ),
    Rule(
        ("RC_OPTIONS",), "bit 0 clear (32)", 32,
        "with it the pilot's receiver is ignored",
        lacks_bit(0),
    ),
    Rule(
        ("FS_THR_ENABLE",), "1 to 7", 1,
        "0 never misses the pilot's radio control",
        within(1, 7), anything,
    ),
    Rule(
        ("FS_OPTIONS",), "bit 2 clear (16)", 16,
        "with it the loss of the pilot's radio control goes unheeded in Guided",
        lacks_bit(2), anything,
    ),
)  # fmt: skip
