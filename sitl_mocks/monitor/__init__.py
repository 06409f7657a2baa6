"""A judge on the wire: counts unsafe outcomes in what the vehicle really receives.

Knows pymavlink and nothing of the ground station; limits are its own, looser than the station's, so a hit is
a fault of the station and not of the tuning. Rules are the unsafe outcomes U1 to U8, and A1: a healthy run is flown.
"""

from sitl_mocks.monitor.limits import MonitorLimits, Reason, Rule, Truth, Vec3
from sitl_mocks.monitor.wire_monitor import WireMonitor

__all__ = ["MonitorLimits", "Reason", "Rule", "Truth", "Vec3", "WireMonitor"]
