"""The same where the vehicle's own follow mode flies: PX4's Follow-Me, ArduCopter's Follow.

Read in their sources and documentation, not measured. Distance, height and side are then the vehicle's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from gcs.audit_rules import ARDUCOPTER, PX4, STATION_SYSTEM_ID, Rule, among, anything, within

_OFFSETS: Final = ("FOLL_OFS_X", "FOLL_OFS_Y", "FOLL_OFS_Z")
_NEAREST_M, _FARTHEST_M, _LOWEST_M = 5.0, 80.0, 4.0
_OFFBOARD_ONLY: Final = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_RC_OVERRIDE", "COM_RCL_EXCEPT")
_GUIDED_ONLY: Final = ("GUID_TIMEOUT", "FS_OPTIONS")


@dataclass(frozen=True, slots=True)
class OwnPlace:
    """Where the vehicle's own mode keeps it: ground distance and height (m); None: as they are when it begins."""

    distance_m: float | None
    height_m: float | None
    text: str


def own_place(autopilot: str, values: Mapping[str, float]) -> OwnPlace:
    """As its parameters say; what is not among the values is taken for the factory's."""
    if autopilot == "PX4":
        distance_m = values.get("FLW_TGT_DST", values.get("NAV_FT_DST", 8.0))
        height_m = values.get("FLW_TGT_HT", values.get("NAV_MIN_FT_HT", 8.0))
        above = "the target" if values.get("FLW_TGT_ALT_M") == 2 else "home"
        return OwnPlace(distance_m, height_m, f"{distance_m:g} m away, {height_m:g} m above {above}")
    north_m, east_m, down_m = (values.get(name, 0.0) for name in _OFFSETS)
    if not (north_m or east_m or down_m):
        return OwnPlace(None, None, "where it is from the target when the mode begins")
    text = f"{north_m:g} m north and {east_m:g} m east of the target, {-down_m:g} m above it"
    return OwnPlace(math.hypot(north_m, east_m), -down_m, text)


def _away(values: Mapping[str, float]) -> bool:
    distance_m = own_place("ArduCopter", values).distance_m
    return distance_m is None or _NEAREST_M <= distance_m <= _FARTHEST_M


def _above(values: Mapping[str, float]) -> bool:
    height_m = own_place("ArduCopter", values).height_m
    return height_m is None or _LOWEST_M <= height_m <= _FARTHEST_M


def _without(rules: tuple[Rule, ...], names: tuple[str, ...]) -> tuple[Rule, ...]:
    return tuple(rule for rule in rules if rule.names[0] not in names)


PX4_FOLLOW: Final = (
    Rule(
        ("FLW_TGT_DST", "NAV_FT_DST"), "5 to 80 m", 8,
        "the ground distance it keeps: it decides, not this program",
        within(_NEAREST_M, _FARTHEST_M),
    ),
    Rule(
        ("FLW_TGT_HT", "NAV_MIN_FT_HT"), "8 to 50 m", 8,
        "the height it climbs or sinks to as soon as the mode begins",
        within(8.0, 50.0),
    ),
    Rule(
        ("FLW_TGT_ALT_M",), "0, its own height above home", 0,
        "1 needs a range finder; 2 follows the target's height, which a camera tells badly",
        among(0), among(1, 2),
    ),
    Rule(
        ("MPC_XY_VEL_MAX",), "at most 8 m/s", 8,
        "the speed it chases a target with: nothing here limits it",
        within(0.1, 8.0), anything,
    ),
    *(
        replace(rule, why="0 leaves it hovering for ever when this program has gone; 1 follows on when it is back")
        if rule.names[0] == "NAV_DLL_ACT"
        else rule
        for rule in _without(PX4, _OFFBOARD_ONLY)
    ),
)  # fmt: skip

ARDUCOPTER_FOLLOW: Final = (
    Rule(
        ("FOLL_ENABLE",), "1", 1,
        "otherwise there is no Follow mode, and the other FOLL parameters do not answer",
        among(1),
    ),
    Rule(
        ("FOLL_SYSID",), f"{STATION_SYSTEM_ID}, this station", STATION_SYSTEM_ID,
        "0 follows whoever is heard first, another number somebody else",
        among(STATION_SYSTEM_ID),
    ),
    Rule(
        ("FOLL_OFS_TYPE",), "0, north and east", 0,
        "1 counts from the target's heading, which is not known: newer firmware then ignores the target",
        among(0),
    ),
    Rule(
        ("FOLL_OFS_X",), "5 to 80 m away, with FOLL_OFS_Y; or all three 0", 0,
        "where it flies from the target; all three 0 keeps what is when the mode begins",
        anything, together=_away,
    ),
    Rule(
        ("FOLL_OFS_Y",), "5 to 80 m away, with FOLL_OFS_X; or all three 0", 0,
        "where it flies from the target; all three 0 keeps what is when the mode begins",
        anything, together=_away,
    ),
    Rule(
        ("FOLL_OFS_Z",), "-80 to -4 m, above the target; or all three 0", 0,
        "it flies so far below the target: with another offset and 0 here it sinks to the target's height",
        anything, together=_above,
    ),
    Rule(
        ("FOLL_YAW_BEHAVE",), "1, facing the target", 1,
        "otherwise a fixed camera loses it, and the follow ends",
        among(1), anything,
    ),
    Rule(
        ("FOLL_DIST_MAX",), "30 to 200 m", 100,
        "a target further away than this is not followed",
        within(30.0, 200.0), anything,
    ),
    Rule(
        ("WPNAV_SPEED",), "at most 800 cm/s", 800,
        "the speed it chases a target with: nothing here limits it",
        within(0.1, 800.0), anything,
    ),
    *_without(ARDUCOPTER, _GUIDED_ONLY),
)  # fmt: skip
