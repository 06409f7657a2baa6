"""A vehicle that speaks MAVLink like PX4 or ArduCopter, without any I/O of its own."""

from sitl_mocks.vehicle.core import MockVehicle
from sitl_mocks.vehicle.faults import Faults
from sitl_mocks.vehicle.flight import Sticks
from sitl_mocks.vehicle.gimbal import MockGimbal
from sitl_mocks.vehicle.modes import Landed, Mode, Personality, Result
from sitl_mocks.vehicle.params import PREPARED
from sitl_mocks.vehicle.pose import Pose
from sitl_mocks.vehicle.telemetry import Home

__all__ = [
    "PREPARED",
    "Faults",
    "Home",
    "Landed",
    "MockGimbal",
    "MockVehicle",
    "Mode",
    "Personality",
    "Pose",
    "Result",
    "Sticks",
]
