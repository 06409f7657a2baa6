"""A small parameter table with each autopilot's way of putting integers into the float of PARAM_VALUE."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from sitl_mocks.vehicle.modes import Personality

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
INTEGER_TYPES = (INT8, INT16, INT32)

_PX4_INTS = {
    "COM_OBL_RC_ACT": 0,
    "COM_RC_OVERRIDE": 1,
    "COM_RC_IN_MODE": 1,
    "COM_RCL_EXCEPT": 0,
    "COM_LOW_BAT_ACT": 3,
    "COM_DL_LOSS_T": 10,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "GF_ACTION": 2,
    "CBRK_SUPPLY_CHK": 894281,
    "MAV_SYS_ID": 1,
    "SYS_AUTOSTART": 10040,
    "FLW_TGT_ALT_M": 0,
}
_PX4_FLOATS = {
    "COM_OF_LOSS_T": 1.0,
    "COM_FAIL_ACT_T": 5.0,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_SPOOLUP_TIME": 1.0,
    "COM_RC_LOSS_T": 0.5,
    "COM_RC_STICK_OV": 30.0,
    "BAT_LOW_THR": 0.15,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "MPC_VEL_MANUAL": 10.0,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_TKO_SPEED": 1.5,
    "MPC_LAND_SPEED": 0.7,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_ACC_HOR": 3.0,
    "RTL_RETURN_ALT": 30.0,
    "FLW_TGT_DST": 8.0,
    "FLW_TGT_FA": 180.0,
    "FLW_TGT_HT": 8.0,
    "FLW_TGT_MAX_VEL": 5.0,
}
_ARDUPILOT_INTS = {
    "ARMING_CHECK": (INT32, 1),
    "BATT_FS_LOW_ACT": (INT8, 0),
    "FENCE_ACTION": (INT8, 1),
    "FENCE_ENABLE": (INT8, 0),
    "FENCE_TYPE": (INT8, 7),
    "FLTMODE_CH": (INT8, 5),
    "FOLL_ENABLE": (INT8, 0),
    "FOLL_OFS_TYPE": (INT8, 0),
    "FOLL_SYSID": (INT16, 0),
    "FOLL_YAW_BEHAVE": (INT8, 1),
    "FS_EKF_ACTION": (INT8, 1),
    "FS_GCS_ENABLE": (INT8, 0),
    "FS_OPTIONS": (INT32, 16),
    "FS_THR_ENABLE": (INT8, 1),
    "GUID_OPTIONS": (INT32, 0),
    "LAND_SPEED": (INT16, 50),
    "MAV_GCS_SYSID": (INT16, 255),
    "MAV_SYSID": (INT16, 1),
    "RC_OPTIONS": (INT32, 32),
    "RTL_ALT": (INT32, 1500),
}
_ARDUPILOT_FLOATS = {
    "BATT_LOW_VOLT": 10.5,
    "DISARM_DELAY": 10.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_RADIUS": 300.0,
    "FS_GCS_TIMEOUT": 5.0,
    "FOLL_DIST_MAX": 100.0,
    "FOLL_OFS_X": 0.0,
    "FOLL_OFS_Y": 0.0,
    "FOLL_OFS_Z": 0.0,
    "GUID_TIMEOUT": 3.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_SPEED": 1000.0,
    "WPNAV_SPEED_DN": 150.0,
    "WPNAV_SPEED_UP": 250.0,
}

# What a careful owner sets before being followed; the rest stays as the autopilot comes.
PREPARED: Mapping[Personality, Mapping[str, float]] = MappingProxyType(
    {
        Personality.PX4: MappingProxyType(
            {
                "COM_OF_LOSS_T": 0.5,
                "COM_OBL_RC_ACT": 5.0,  # Hold
                "COM_RC_OVERRIDE": 3.0,  # sticks take over in OFFBOARD too
                "NAV_DLL_ACT": 2.0,  # Return; 1 (Hold) goes back into OFFBOARD by itself when heartbeats return
                "GF_ACTION": 2.0,
                "GF_MAX_HOR_DIST": 500.0,
                "GF_MAX_VER_DIST": 120.0,
            }
        ),
        Personality.ARDUPILOT: MappingProxyType(
            {
                "GUID_TIMEOUT": 1.0,
                "FS_GCS_ENABLE": 1.0,  # RTL
                "MAV_GCS_SYSID": 255.0,
                "FENCE_ENABLE": 1.0,
                "FENCE_ACTION": 1.0,
                "FENCE_RADIUS": 500.0,
                "FENCE_ALT_MAX": 120.0,
            }
        ),
    }
)


@dataclass(slots=True)
class Parameters:
    """Names to (type, value), sorted by name as both autopilots list them."""

    bytewise: bool
    _table: dict[str, tuple[int, float]] = field(default_factory=dict)
    changes: int = 0  # how often a value was set

    @classmethod
    def defaults(cls, personality: Personality, changes: Mapping[str, float]) -> Parameters:
        """The defaults read back from the simulators, with `changes` on top; ValueError for an unknown name."""
        if personality is Personality.PX4:
            table = {name: (INT32, float(value)) for name, value in _PX4_INTS.items()}
            floats = _PX4_FLOATS
        else:
            table = {name: (kind, float(value)) for name, (kind, value) in _ARDUPILOT_INTS.items()}
            floats = _ARDUPILOT_FLOATS
        table |= {name: (REAL32, value) for name, value in floats.items()}
        params = cls(personality is Personality.PX4, dict(sorted(table.items())))
        for name, value in changes.items():
            params[name] = value
        return params

    def __getitem__(self, name: str) -> float:
        return self._table[name][1]

    def __setitem__(self, name: str, value: float) -> None:
        if name not in self._table:
            raise ValueError(f"the mock vehicle has no parameter {name!r}")
        if not math.isfinite(value):
            raise ValueError(f"parameter {name} must be finite, got {value}")
        kind = self._table[name][0]
        self.changes += 1
        self._table[name] = (kind, float(round(value)) if kind in INTEGER_TYPES else float(value))

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def __len__(self) -> int:
        return len(self._table)

    def names(self) -> list[str]:
        """Names in the order of their index."""
        return list(self._table)

    def wire_value(self, name: str) -> tuple[float, int, int]:
        """(param_value as float, param_type, param_index) of PARAM_VALUE; PX4 puts INT32 in byte by byte."""
        kind, value = self._table[name]
        index = self.names().index(name)
        if self.bytewise and kind in INTEGER_TYPES:
            return struct.unpack("<f", struct.pack("<i", int(value)))[0], kind, index
        return value, kind, index

    def set_from_wire(self, name: str, param_value: float, param_type: int) -> bool:
        """Take a PARAM_SET; False when the name is unknown, the value is no number or, on PX4, the type differs."""
        if name not in self._table or (self.bytewise and param_type != self._table[name][0]):
            return False
        if self.bytewise and param_type in INTEGER_TYPES:
            param_value = float(struct.unpack("<i", struct.pack("<f", param_value))[0])
        if not math.isfinite(param_value):
            return False
        self[name] = param_value
        return True
