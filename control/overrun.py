"""Whether the vehicle, flying as it does, still stops inside the fence: for a vehicle that we do not steer. Pure."""

from __future__ import annotations

from control.gate_limits import Limits, bounds, height_bounds, outside
from control.types import VehicleState


def leaves_fence(vehicle: VehicleState, limits: Limits, *, steered: bool = True) -> bool:
    """Outside already, or, where it flies by itself, too fast towards a side, the floor or the ceiling to be stopped.

    The setpoints of the gate never are that, so for a steered vehicle only its place counts.
    """
    if outside(vehicle.position_ned_m, vehicle.height_m, limits):
        return True
    if steered:
        return False
    north, east, down = vehicle.velocity_ned_mps
    sink_mps, rise_mps = height_bounds(vehicle, limits)
    too_fast = any(n * north + e * east > most_mps for n, e, most_mps in bounds(vehicle, limits))
    return too_fast or not -rise_mps <= down <= sink_mps
