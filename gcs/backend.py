"""The two ways a follow can reach a vehicle. Here, so that a configuration is read without anything of MAVLink."""

from __future__ import annotations

from enum import Enum


class Backend(Enum):
    """By velocity setpoints, or by publishing the target to the vehicle's own follow mode."""

    SETPOINTS = "setpoints"
    FOLLOW_TARGET = "follow-target"
