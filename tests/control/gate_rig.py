"""A healthy vehicle before the gate, shared by the tests of the gate."""

from dataclasses import replace

from control import gate as gate_module
from control.gate import Limits, Setpoint, gate
from control.types import VehicleMode, VehicleState, VelocityRequest

NOW = 100.0
LIMITS = Limits()
HEALTHY = VehicleState(
    heartbeat_t_s=NOW, mode=VehicleMode.EXTERNAL, mode_t_s=NOW, armed=True, in_air=True,
    attitude_t_s=NOW, position_t_s=NOW, height_m=20.0,
)  # fmt: skip


def request(velocity=(0.1, 0.0, 0.0), yaw_rate=0.0, t_s=NOW, **kwargs):
    return VelocityRequest(t_s, velocity, yaw_rate, **kwargs)


def settle(velocity, yaw_rate=0.0, vehicle=HEALTHY, limits=LIMITS):
    """The setpoint and reason after the gate has seen the same request for ten seconds."""
    setpoint, reason, now = None, None, NOW
    for _ in range(200):
        now += 0.05
        fresh = replace(vehicle, heartbeat_t_s=now, mode_t_s=now, attitude_t_s=now, position_t_s=now)
        setpoint, reason = gate(request(velocity, yaw_rate, now), fresh, now, setpoint, limits)
    return setpoint, reason


def replace_time(setpoint, t_s=NOW - 0.05):
    """The same setpoint as if sent one tick ago; the token shows that tests must break in to do so."""
    return Setpoint(t_s, setpoint.velocity_ned_mps, setpoint.yaw_rate_rps, gate_module._TOKEN)
