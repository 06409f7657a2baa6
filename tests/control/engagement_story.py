"""An engagement that is told a healthy flight tick by tick, but for what a test changes."""

import copy
from dataclasses import replace

from control.config import EngagementConfig
from control.engagement import Engagement, Inputs, State
from control.types import VehicleMode, VehicleState

CONFIG = EngagementConfig()
TICK = 0.05


def healthy(now, mode=VehicleMode.EXTERNAL, **changes):
    """Everything green at this moment."""
    vehicle = VehicleState(
        heartbeat_t_s=now, mode=mode, mode_t_s=now, armed=True, in_air=True, attitude_t_s=now, position_t_s=now,
        height_m=10.0, battery_frac=0.8,
    )  # fmt: skip
    vehicle_changes = {k: changes.pop(k) for k in list(changes) if k in VehicleState.__dataclass_fields__}
    inputs = Inputs(
        vehicle=replace(vehicle, **vehicle_changes), frame_t_s=now, selected=True, measured_t_s=now, confidence=0.9,
        latency_s=0.15, attitude_rate_hz=50.0, request_t_s=now,
    )  # fmt: skip
    return replace(inputs, **changes)


class Story:
    """An engagement with a clock."""

    def __init__(self):
        self.machine, self.now, self.out = Engagement(CONFIG), 100.0, None

    def tick(self, mode=VehicleMode.EXTERNAL, dt=TICK, **changes):
        self.now += dt
        self.out = self.machine.update(self.now, healthy(self.now, mode, **changes))
        return self.out

    def follow(self):
        """Select, confirm, and be followed by a vehicle that takes up the mode."""
        self.tick(VehicleMode.HOLD)
        self.tick(VehicleMode.HOLD, confirm=True)
        self.tick()
        assert self.out.state is State.FOLLOWING
        return self

    def reach(self, state):
        """Walk to a state the ordinary way."""
        unseen = {"measured_t_s": self.now}
        if state is State.NO_VIDEO:
            self.tick(VehicleMode.HOLD, frame_t_s=None, selected=False)
        elif state is State.IDLE:
            self.tick(VehicleMode.HOLD, selected=False)
        elif state is State.SELECTED:
            self.tick(VehicleMode.HOLD)
        else:
            self.follow()
            unseen = {"measured_t_s": self.now}
            if state is State.COASTING:
                self.ticks(8, **unseen)
            elif state is State.LOST_HOLD:
                self.ticks(22, **unseen)
            elif state is State.RELEASED:
                self.tick(abort=True)
                self.ticks(12, mode=VehicleMode.HOLD)
            elif state is State.TAKEN_OVER:
                self.tick(VehicleMode.MANUAL)
        assert self.out.state is state
        return self

    def ticks(self, count, **changes):
        return [self.tick(**changes) for _ in range(count)]

    def copy(self):
        """The same moment, to go on from without touching this one."""
        twin = copy.copy(self)
        twin.machine = copy.copy(self.machine)  # flat: a shallow copy is a life of its own
        return twin
