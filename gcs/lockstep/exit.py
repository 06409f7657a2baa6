"""What leaves the station, before any link has had a hand in it."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import Vec3

_STILL = 1e-6
_SILENCE_S = 0.5
_ACCELERATION_MPS2 = 4.0


def _robust_parser() -> Any:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return parser


@dataclass(slots=True)
class Exit:
    """Every setpoint that leaves the station, decoded by pymavlink alone."""

    setpoints: list[tuple[float, bool]] = field(default_factory=list)  # (time, moving)
    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)  # of the newest
    faults: list[str] = field(default_factory=list)  # what no link can have done: a step, a follow begun anew
    ended: bool = False  # the station has said that the follow is over
    digest: int = 0
    _parser: Any = field(init=False, repr=False, default_factory=_robust_parser)

    def note(self, now_s: float, datagram: bytes) -> None:
        """One datagram left at now_s."""
        self.digest = zlib.crc32(datagram, self.digest ^ round(now_s * 1e6) & 0xFFFFFFFF)
        for message in self._parser.parse_buffer(bytearray(datagram)) or ():
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                before, self.velocity_ned_mps = self.velocity_ned_mps, (message.vx, message.vy, message.vz)
                dt_s = now_s - self.setpoints[-1][0] if self.setpoints else math.inf
                step_mps = math.dist(before if dt_s < _SILENCE_S else (0.0, 0.0, 0.0), self.velocity_ned_mps)
                if any(self.velocity_ned_mps) and step_mps > _ACCELERATION_MPS2 * min(max(dt_s, 0.05), 0.2) + 1e-3:
                    self.faults.append(f"velocity step {step_mps:.3f} m/s after {dt_s:.3f} s at the exit")
                moving = max(*map(abs, self.velocity_ned_mps), abs(message.yaw_rate)) > _STILL
                self.setpoints.append((now_s, moving))
                if moving and self.ended:
                    self.faults.append(f"moving again at {now_s:.3f} s, after the follow was over")

    def last_s(self, moving: bool) -> float | None:
        """When the last setpoint left; moving: the last that was not zero."""
        return next((t_s for t_s, moves in reversed(self.setpoints) if moves or not moving), None)

    def any_moving(self, from_s: float, to_s: float) -> bool:
        """Whether the vehicle was being moved in that time."""
        return any(moves and from_s <= t_s <= to_s for t_s, moves in self.setpoints)
