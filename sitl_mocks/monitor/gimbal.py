"""What is sent to a gimbal: bounded rates, and none that turn while the vehicle is not being flown."""

from __future__ import annotations

import math
from typing import Any

from sitl_mocks.monitor import frames
from sitl_mocks.monitor.limits import MonitorLimits

_STILL = 1e-6


def rates_rps(message: Any) -> tuple[float, ...] | None:
    """The rates a message puts in force, rad/s, NaN = that axis is not turned by a rate; None: no such message."""
    number = message.get_msgId()
    if number == frames.GIMBAL_PITCHYAW:
        return message.pitch_rate, message.yaw_rate
    if number == frames.GIMBAL_ATTITUDE:
        return message.angular_velocity_x, message.angular_velocity_y, message.angular_velocity_z
    if number == frames.COMMAND_LONG and message.command == frames.GIMBAL_COMMAND:
        return math.radians(message.param3), math.radians(message.param4)
    return None


def bad_rates(rates: tuple[float, ...], limits: MonitorLimits) -> str | None:
    """U1, in words."""
    if any(math.isinf(rate) or abs(rate) > limits.gimbal_rate_max_rps * (1 + 1e-4) for rate in rates):
        return f"gimbal rates {', '.join(f'{rate:.3f}' for rate in rates)} rad/s"
    return None


def turning(rates: tuple[float, ...]) -> bool:
    """Whether the gimbal is to turn by a rate."""
    return any(abs(rate) > _STILL for rate in rates)
