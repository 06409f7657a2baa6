"""The demo's operator: what a person would do, with the simulator's truth for eyes."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from typing import Final

from control.engagement import State
from gcs.audit import Audit
from gcs.clock import Clock
from gcs.demo_report import Span, TrackedFrame
from gcs.demo_simulator import Simulator
from gcs.errors import GcsError
from gcs.flight import Flight
from gcs.flight_control import Tick
from gcs.flight_orders import Orders, RefusedError
from gcs.flight_view import Sighting
from gcs.operator.orders import Acknowledge, Confirm, Land, Select, TakeOff
from gcs.video import Frame
from tracker.box import Box

_READY_S: Final = 30.0
_PATIENCE_S: Final = 15.0  # for a target to come into view, or a confirmation to be accepted
_LOOK_S: Final = 1.0  # between drawing the box and confirming
_AGAIN_S: Final = 0.5
_LAND_S: Final = 40.0
_HAND_FRAC: Final = 0.04  # how far a hand-drawn box is off, of its sides
_LOST: Final = (State.RELEASED, State.TAKEN_OVER)


class DemoOperator:
    """Takes off, draws a box, confirms, watches, lands. Also a `Watcher`: collects what is judged afterwards."""

    def __init__(
        self, flight: Flight, world: Simulator, clock: Clock, say: Callable[[str], None], follow_s: float, seed: int
    ) -> None:
        self._flight = flight
        self._orders = Orders(flight)
        self._world = world
        self._clock = clock
        self._say = say
        self._follow_s = follow_s
        self._random = random.Random(seed)
        self._confirmed: list[tuple[float, float]] = []  # (when, standoff)
        self._end_s = 0.0
        self.frames: list[TrackedFrame] = []
        self.has_landed = False

    def saw(self, sighting: Sighting) -> None:
        """Keep the tracker's box."""
        result = sighting.seen.result
        self.frames.append(
            TrackedFrame(sighting.seen.frame.t_capture_s, result.box if result and result.visible else None)
        )

    def ticked(self, tick: Tick) -> None:
        """Nothing is needed of the ticks."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nothing is needed of the audit."""

    def spans(self) -> list[Span]:
        """From each confirmation to the next, the last one to the end: lost time is counted in."""
        ends = [when for when, _ in self._confirmed[1:]] + [self._end_s]
        return [Span(when, end, standoff) for (when, standoff), end in zip(self._confirmed, ends, strict=True)]

    async def run(self) -> None:
        """The whole flight; ends it when the vehicle has landed."""
        await self._flight.link.actions.wait_ready(_READY_S)
        self._say("taking off")
        self._say(await self._orders.perform(TakeOff(self._world.height_m)))
        if await self._begin():
            end_s = self._confirmed[0][0] + self._follow_s
            try:
                await self._watch(end_s)
            finally:  # also when the person at the keyboard ends it
                self._end_s = min(self._clock.now_s(), end_s)
        await self._land()
        self._flight.stop()

    async def _begin(self) -> bool:
        """Draw and confirm; False, said aloud, if that does not work."""
        deadline_s = self._clock.now_s() + _PATIENCE_S
        reason = "the target is not in view"
        while self._clock.now_s() < deadline_s:
            try:
                if await self._draw() and await self._confirm(deadline_s):
                    return True
            except GcsError as error:
                reason = str(error)
            await asyncio.sleep(_AGAIN_S)
        self._say(f"nothing is followed: {reason}")
        return False

    async def _draw(self) -> bool:
        """A box round the target in the newest picture, about as well as a hand draws it."""
        frame = (await self._flight.next_seen()).frame
        box = self._eye(frame)
        if box is None:
            return False
        self._say(await self._orders.perform(Select(box, frame)))
        await asyncio.sleep(_LOOK_S)
        return True

    def _eye(self, frame: Frame) -> Box | None:
        row = self._world.truth_at(frame.t_capture_s)
        if row is None or row.box_xywh_px is None or row.visible_frac < 0.9:
            return None
        true = Box.from_xywh(*row.box_xywh_px)
        dx, dy, dw, dh = (self._random.gauss(0.0, _HAND_FRAC) for _ in range(4))
        return Box(true.cx_px + dx * true.w_px, true.cy_px + dy * true.h_px, true.w_px * (1 + dw), true.h_px * (1 + dh))

    async def _confirm(self, deadline_s: float) -> bool:
        while True:
            try:
                self._world.operator_confirms()
                self._say(await self._orders.perform(Confirm()))
            except RefusedError:
                if self._clock.now_s() > deadline_s:
                    raise
                await asyncio.sleep(_AGAIN_S)
                continue
            confirmation = self._flight.control.confirmation
            assert confirmation is not None
            self._confirmed.append((self._clock.now_s(), confirmation.standoff_m))
            return True

    async def _watch(self, end_s: float) -> None:
        """Look on until the time is over; draw a new box when the target has been lost for good."""
        while self._clock.now_s() < end_s:
            tick = await self._flight.next_tick()
            if tick.output.state not in _LOST:
                continue
            self._say("the target was lost: drawing a new box")
            await self._orders.perform(Acknowledge())
            if not await self._begin():
                return

    async def _land(self) -> None:
        self._say(await self._orders.perform(Land()))
        telemetry = self._flight.link.telemetry
        self.has_landed = await telemetry.wait_for(lambda s: not s.in_air and s.mode_t_s is not None, _LAND_S)
        state = telemetry.vehicle_state()
        if not self.has_landed:
            self._say(f"not landed within {_LAND_S:g} s: {state.height_m:.1f} m high in {state.mode.value}")
