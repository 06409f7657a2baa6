"""What an operator's order does to a flight, and the answer he gets."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Final, assert_never

from control.adjust import change_mode, change_standoff
from control.causes import Cause
from control.engagement import State
from control.modes import Confirmation, ConfirmError
from control.motion import distance_m
from control.types import VehicleMode
from gcs.candidates import Candidate, box_at
from gcs.errors import GcsError, SelectionError
from gcs.flight_control import Act, Tick
from gcs.operator.orders import (
    Abort,
    Accept,
    Acknowledge,
    Confirm,
    Deselect,
    Hold,
    Land,
    Order,
    Quit,
    Record,
    Return,
    Select,
    SelectCandidate,
    SelectPoint,
    SetDistance,
    SetMode,
    SetStandoff,
    StepStandoff,
    TakeOff,
    words_of,
)
from gcs.ordered import OrderedFlight
from gcs.recorder.events import Ordered, Selected
from gcs.selection import check_box

_SELECT_S: Final = 5.0
_RELEASE_S: Final = 5.0
_ENDED: Final = (State.RELEASED, State.TAKEN_OVER)


class RefusedError(GcsError):
    """An order that is not carried out now, with every reason."""


class Orders:
    """candidates: those of now, which an order may name by their numbers."""

    def __init__(self, flight: OrderedFlight, candidates: Callable[[], tuple[Candidate, ...]] = tuple) -> None:
        self._flight = flight
        self._candidates = candidates

    async def perform(self, order: Order) -> str:
        """Do it and answer in one line; GcsError with the reason if it is not done."""
        flight, t_s = self._flight, self._flight.clock.now_s()
        try:
            answer = await self._perform(order)
        except (GcsError, ValueError) as error:
            flight.journal.note(t_s, Ordered(words_of(order), str(error), refused=True))
            raise
        flight.journal.note(t_s, Ordered(words_of(order), answer))
        return answer

    async def _perform(self, order: Order) -> str:
        flight, control = self._flight, self._flight.control
        match order:
            case Select():
                return await self._select(order)
            case SelectPoint() | SelectCandidate():
                return await self._select(await self._box_of(order))
            case Deselect():
                return await self._deselect()
            case Confirm():
                return await self._confirm()
            case Acknowledge():
                await self._settle()
                control.act(Act.ACKNOWLEDGE)
                await flight.next_tick()
                return "acknowledged"
            case Abort():
                flight.abort()
                return "abort: zero, then hold"
            case Hold():
                return await self._hold()
            case TakeOff(height_m):
                return await self._take_off(height_m)
            case Land():
                await self._let_go()
                await flight.link.actions.land()
                return "landing"
            case Return():
                await self._let_go()
                await flight.link.actions.return_to_launch()
                return "returning home"
            case SetMode() | SetStandoff() | StepStandoff() if flight.output.decides:
                raise RefusedError(f"not for an order: {flight.output.decides}")
            case SetMode() | SetStandoff() if control.is_engaged:
                changed = self._change(order)
                self._want(order)
                return changed
            case SetMode() | SetStandoff() | SetDistance():
                return self._want(order)
            case StepStandoff():
                return self._change(order)
            case Accept(name):
                return flight.auditor.accept(name)
            case Record(on):
                return self._record(on)
            case Quit():
                flight.stop()
                return "leaving"
            case _:
                assert_never(order)

    async def _select(self, order: Select) -> str:
        flight = self._flight
        if flight.control.is_engaged:
            raise RefusedError("a target is being followed: abort first")
        await self._settle()
        box = check_box(order.box, flight.camera.width_px, flight.camera.height_px)
        number = flight.vision.select(box, order.frame)
        self._target(Selected(number, box, order.frame.seq if order.frame is not None else None, number))
        try:
            async with asyncio.timeout(_SELECT_S):
                while (seen := await flight.next_seen()).selection != number:
                    if flight.vision.selections != number:
                        return "another selection came right after it"
        except TimeoutError:
            raise SelectionError(f"no picture came within {_SELECT_S:g} s to select in") from None
        if seen.problem is not None:
            self._target(Selected(0, None, None, 0))
            raise SelectionError(seen.problem)
        x, y, w, h = box.xywh
        return f"selected {w:.0f}x{h:.0f} px at {x:.0f},{y:.0f}; confirm to follow"

    async def _box_of(self, order: SelectPoint | SelectCandidate) -> Select:
        """What was pointed at, as a box drawn by hand."""
        if isinstance(order, SelectCandidate):
            found = next((each for each in self._candidates() if each.number == order.number), None)
            if found is None:
                raise SelectionError(f"there is no candidate {order.number}")
            return Select(found.box, found.frame)
        frame = order.frame or self._flight.vision.frames.newest
        if frame is None:
            raise SelectionError("no picture has come yet")
        point = order.x_px, order.y_px, order.radius_px
        return Select(await asyncio.to_thread(box_at, frame.image_bgr, *point), frame)

    async def _deselect(self) -> str:
        flight = self._flight
        if flight.control.is_engaged:
            raise RefusedError("a target is being followed: abort first")
        await self._settle()
        self._target(Selected(flight.vision.select(None), None, None, 0))
        await flight.next_tick()
        return "nothing is selected"

    def _target(self, selected: Selected) -> None:
        """Control takes it as its target, or has none any more."""
        flight = self._flight
        flight.journal.note(flight.clock.now_s(), selected)
        flight.control.select(selected.target)

    async def _settle(self) -> None:
        """Wait until a hold that was commanded is seen or given up: before that nothing new can begin."""
        while self._flight.tick is not None and self._flight.tick.output.settling:
            await self._flight.next_tick()

    async def _confirm(self) -> str:
        flight = self._flight
        if flight.control.is_engaged:
            return "already following"
        flight.control.act(Act.CONFIRM)
        tick = await flight.next_tick()
        refused = () if tick.output.engaging else self._why_not(tick)
        if refused:
            raise RefusedError("not following: " + "; ".join(refused))
        while tick.output.engaging:
            tick = await flight.next_tick()
        if tick.output.state in _ENDED:
            raise RefusedError("not following: " + "; ".join(cause.value for cause in tick.output.reasons))
        confirmation = flight.control.confirmation
        if confirmation is None or not flight.control.is_engaged:
            raise RefusedError("not following: it was aborted at the same moment")
        if flight.output.label:
            return f"{confirmation.mode.value} confirmed {confirmation.standoff_m:.1f} m away, by {flight.output.label}"
        return f"{confirmation.mode.value} confirmed at {confirmation.standoff_m:.1f} m"

    def _why_not(self, tick: Tick) -> tuple[str, ...]:
        if tick.output.state in (State.FOLLOWING, State.COASTING):  # the vehicle was in external control before
            return ()
        better = {Cause.NO_DISTANCE: self._flight.control.confirm_problem, Cause.AUDIT: self._flight.why_unfit()}
        causes = tuple(better.get(cause) or cause.value for cause in tick.output.reasons)
        gimbal = self._flight.gimbal
        return causes if gimbal is None or not causes else (*causes, *gimbal.warnings(tick.t_s))

    async def _hold(self) -> str:
        if self._flight.control.is_engaged:
            await self._let_go()
        else:
            await self._flight.link.modes.hold()
        return f"the vehicle is in {self._mode().value}"

    async def _take_off(self, height_m: float | None) -> str:
        flight = self._flight
        if flight.control.is_engaged:
            raise RefusedError("a target is being followed: abort first")
        height_m = flight.config.vehicle.takeoff_height_m if height_m is None else height_m
        if not flight.link.telemetry.vehicle_state().armed:
            await flight.link.actions.arm()
        await flight.link.actions.takeoff(height_m)
        return f"at {flight.link.telemetry.vehicle_state().height_m:.1f} m"

    async def _let_go(self) -> None:
        """Before any other mode: zero and hold, so that what comes next is not taken for a pilot's takeover."""
        if not self._flight.control.is_engaged:
            return
        self._flight.abort()
        try:
            async with asyncio.timeout(_RELEASE_S):
                while self._flight.control.is_engaged or self._mode() is VehicleMode.EXTERNAL:
                    await self._flight.next_tick()
        except TimeoutError:
            raise RefusedError(f"the vehicle does not hold: its mode is {self._mode().value}") from None

    def _change(self, order: SetMode | SetStandoff | StepStandoff) -> str:
        """What is followed goes on being followed, otherwise."""
        flight, control = self._flight, self._flight.control
        now_s, follow = flight.clock.now_s(), flight.config.control.follow
        target, held = control.predict(now_s), control.confirmation
        if flight.tick is None or flight.tick.output.state is not State.FOLLOWING or target is None or held is None:
            raise RefusedError("only while a target is followed and seen")
        try:
            match order:
                case SetMode(mode):
                    vehicle, typed_m = flight.link.telemetry.vehicle_state(), control.wanted.distance_m
                    changed = change_mode(held, mode, target, vehicle, now_s, follow, distance_m=typed_m)
                case SetStandoff(standoff_m):
                    changed = change_standoff(held, standoff_m or distance_m(held, target), follow)
                case StepStandoff(by_m):
                    changed = change_standoff(held, (held.standoff_goal_m or held.standoff_m) + by_m, follow)
                case _:
                    assert_never(order)
        except ConfirmError as error:
            raise RefusedError(str(error)) from None
        control.change(changed)
        return _held_line(changed)

    def _want(self, order: SetMode | SetStandoff | SetDistance) -> str:
        control = self._flight.control
        match order:
            case SetMode(mode):
                control.wanted = replace(control.wanted, mode=mode)
            case SetStandoff(standoff_m):
                control.wanted = replace(control.wanted, standoff_m=standoff_m)
            case SetDistance(distance_m):
                control.wanted = replace(control.wanted, distance_m=distance_m)
            case _:
                assert_never(order)
        wanted = control.wanted
        standoff = "as at that moment" if wanted.standoff_m is None else f"{wanted.standoff_m:g} m"
        distance = "from height and view angle" if wanted.distance_m is None else f"{wanted.distance_m:g} m"
        return f"the next confirmation: {wanted.mode.value}, standoff {standoff}, distance {distance}"

    def _record(self, on: bool | None) -> str:
        film = self._flight.film
        if film is None:
            raise RefusedError("no film can be made: recorder.video is off")
        film.on = not film.on if on is None else on
        return "filming" if film.on else "not filming; the log is kept all the same"

    def _mode(self) -> VehicleMode:
        return self._flight.link.telemetry.vehicle_state().mode


def _held_line(confirmation: Confirmation) -> str:
    """What is being held now."""
    if not confirmation.mode.holds_distance:
        return confirmation.mode.value
    goal_m = confirmation.standoff_m if confirmation.standoff_goal_m is None else confirmation.standoff_goal_m
    return f"{confirmation.mode.value} at {goal_m:.1f} m"
