"""The lockstep world with what a fault needs: a station that stands still or is gone, and bounds that count from it."""

from __future__ import annotations

import math
from collections.abc import Callable

from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.target import STEP_S, Walker
from gcs.lockstep.world import Setup, World

_RECENT_S = 0.25


class FaultWorld(World):
    """Faults change its parts; `caused` says when the bound begins to count."""

    target: Walker

    def __init__(self, loop: LockstepLoop, setup: Setup) -> None:
        super().__init__(loop, setup)
        self.target_heading_rad: float | None = None  # where it goes once confirmed; None: somewhere away
        self.frozen = False  # the station's process stands still: what comes in waits
        self.dead = False  # it is gone
        self.cause_s = math.inf  # when the fault came
        self.bound_s: float | None = None
        self.silent = False  # the bound is for setpoints of any kind
        self.engaged_before = False
        self.was_moving = False

    def leave(self, data: bytes) -> bool:
        """A station that is gone sends nothing."""
        return not self.dead and super().leave(data)

    def hand_over(self, now_s: float) -> None:
        """A station that stands still, or is gone, reads nothing."""
        if not (self.frozen or self.dead):
            super().hand_over(now_s)

    def caused(self, now_s: float) -> None:
        """The fault's bound counts from now on."""
        self.cause_s = now_s
        self.engaged_before = self.flight.control.is_engaged
        self.was_moving = self.exit.any_moving(now_s - _RECENT_S, now_s)
        if self.bound_s is None:
            return
        by_s = now_s + self.bound_s + self.up.conditions.delay_s + 2 * STEP_S
        if self.silent:
            self.monitor.silent_by_s = by_s
        else:
            self.monitor.still_by_s = by_s

    def rested(self) -> bool:
        """Nothing has moved the vehicle since the fault: the control law was not asked."""
        return not self.exit.any_moving(self.cause_s, math.inf)

    def cause_is_motion(self) -> None:
        """A fault that is there from the start harms from the first moving setpoint on."""
        self.caused_when(lambda: self.exit.last_s(moving=True) is not None)

    def caused_when(self, condition: Callable[[], bool]) -> None:
        """The fault's bound counts from when this is true."""

        def watch(now_s: float) -> None:
            if condition():
                self.caused(now_s)
                self.hooks.remove(watch)

        self.hooks.append(watch)

    def stall(self, seconds: float) -> None:
        """The station's whole process stands still for so long; the world goes on."""
        self.frozen = True
        now_s = self.loop.time()
        end_s = now_s + seconds
        while now_s + STEP_S <= end_s:
            now_s += STEP_S
            self.loop.stall(now_s)
            self.step(now_s)
        self.frozen = False
        self.hand_over(self.loop.time())
