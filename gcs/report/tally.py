"""A flight's messages, one after the other, to the figures and curves of its report. Memory stays small."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Final, TypeVar

from control.config import FollowConfig
from control.engagement import State
from control.gate_limits import TICK_S
from control.types import VehicleMode
from gcs.audit import Audit
from gcs.link_meters import LinkFigures
from gcs.map_paths import target_of
from gcs.recorder.events import Ordered, Received, Refusals, Said, Selected
from gcs.replay.log import Entry, FrameRow, TickRow
from gcs.report.figures import Event, Order, Phase, Standing, Words
from gcs.report.heard import Heard
from gcs.report.sampling import Curve, Place, Trail
from gcs.report.tally_follow import FOLLOWED, UNSEEN, FollowTally
from gcs.report.tally_link import LinkTally
from gcs.report.tally_time import LatencyTally
from tracker.box import Box

T = TypeVar("T")
_MOST: Final = 500  # of each kind of line
_LONGEST_TICK_S: Final = 0.5  # a longer one is a pause, not time that was spent in a state
# Orders that the decisions tell of themselves, when they were carried out.
_TAKEN_UP: Final = frozenset({"box", "point", "pick", "follow", "abort", "ack"})


@dataclass(slots=True)
class Tally:
    """`add` each entry of a `FlightLog`, then `finish`. All times it gives: seconds since start_s.

    mount_yaw_rad: as in `FollowTally`. phases_left_out: changes of state after the last phase that is kept.
    """

    start_s: float
    follow_config: FollowConfig = field(default_factory=FollowConfig)
    is_import: bool = False  # another station flew it: its decisions tell the vehicle alone
    mount_yaw_rad: float = 0.0
    events: list[Event] = field(default_factory=list)
    phases: list[Phase] = field(default_factory=list)
    phases_left_out: int = 0
    orders: list[Order] = field(default_factory=list)
    refusals: list[Standing] = field(default_factory=list)
    said: list[Words] = field(default_factory=list)
    left_out: int = 0
    frames: int = 0
    longest_pause_s: float = 0.0
    problems: Counter[str] = field(default_factory=Counter)
    follow: FollowTally = field(init=False)
    link: LinkTally = field(init=False)
    latency: LatencyTally = field(default_factory=LatencyTally)
    heard: Heard = field(default_factory=Heard)
    height_m: Curve = field(default_factory=Curve)
    battery: Curve = field(default_factory=Curve)  # percent
    confidence: Curve = field(default_factory=Curve)
    pause_ms: Curve = field(default_factory=Curve)
    vehicle_path: Trail = field(default_factory=Trail)
    target_path: Trail = field(default_factory=Trail)
    _last: TickRow | None = None
    _told: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.follow, self.link = FollowTally(self.start_s, self.mount_yaw_rad), LinkTally(self.start_s)

    def add(self, entry: Entry) -> None:
        """One message."""
        t_s, _, message = entry
        at_s = t_s - self.start_s
        match message:
            case TickRow():
                self._tick(message, at_s)
            case FrameRow():
                self._frame(message)
            case Received():
                self._received(message, t_s)
            case LinkFigures():
                self.link.figures(message, at_s)
            case Audit():
                self.link.audited(message)
            case Ordered():
                self._ordered(message, at_s)
            case Selected(number=number, box=box):
                self._event(at_s, "tracker", f"is given box {number}: {_where(box)}")
            case Said(text=text):
                _keep(self.said, Words(at_s, "station", text))
            case Refusals(reasons=reasons):
                _keep(self.refusals, Standing(at_s, reasons))
            case _:  # what only a second flight needs
                pass

    def finish(self, lasted_s: float) -> None:
        """There is no more; lasted_s: to the last message."""
        self.follow.finish(lasted_s)
        self._end_phase(lasted_s)
        self.events.sort(key=lambda line: line.t_s)  # an order is written down once it is answered
        self.orders.sort(key=lambda line: line.t_s)
        self.said.sort(key=lambda line: line.t_s)

    # -- decisions ----------------------------------------------------------------------------------------

    def _tick(self, tick: TickRow, at_s: float) -> None:
        last, self._last = self._last, tick
        step_s = TICK_S
        if last is None:  # from here on the decisions tell the vehicle's mode, in our words
            self.events = [event for event in self.events if event.kind != "vehicle"]
        else:
            step_s = tick.t_s - last.t_s
        self._vehicle(tick, at_s)
        if self.is_import:
            return
        if last is not None:
            self.longest_pause_s = max(self.longest_pause_s, step_s)
            self.pause_ms.add(at_s, step_s * 1000)
        self._acts(tick, at_s)
        self._state(tick, at_s)
        self.follow.tick(tick, min(max(step_s, 0.0), _LONGEST_TICK_S))
        if tick.budget is not None:
            self.latency.add(tick.budget, at_s)

    def _state(self, tick: TickRow, at_s: float) -> None:
        output = tick.output
        name = "engaging" if output.engaging else output.state.value
        why = tuple(cause.value for cause in output.reasons)
        if self._tell(at_s, "state", f"{name.upper()}: {'; '.join(why)}" if why else name.upper()):
            self._end_phase(at_s)
            if not _keep(self.phases, Phase(at_s, at_s, name, why)):
                self.phases_left_out += 1

    def _end_phase(self, at_s: float) -> None:
        """The newest ends then, unless it ended before one that is left out."""
        if self.phases and not self.phases_left_out:
            last = self.phases[-1]
            self.phases[-1] = replace(last, end_s=max(at_s, last.start_s))

    def _acts(self, tick: TickRow, at_s: float) -> None:
        inputs = tick.inputs
        acts = (
            ("selects", inputs.select), ("confirms", inputs.confirm), ("stops", inputs.abort),
            ("acknowledges", inputs.acknowledge),
        )  # fmt: skip
        for name, done in acts:
            if done:
                self._event(at_s, "operator", name)

    def _vehicle(self, tick: TickRow, at_s: float) -> None:
        vehicle, state = tick.inputs.vehicle, tick.output.state
        if vehicle.mode is not VehicleMode.UNKNOWN:
            armed = "armed" if vehicle.armed else "disarmed"
            self._tell(at_s, "vehicle", f"{vehicle.mode.value}, {armed}")
        if vehicle.battery_frac is not None:
            self.battery.add(at_s, vehicle.battery_frac * 100)
        if vehicle.position_t_s is None:
            return
        kind = "unseen" if state in UNSEEN else "following" if state is State.FOLLOWING else "other"
        north_m, east_m, _ = vehicle.position_ned_m
        self.height_m.add(at_s, vehicle.height_m)
        self.vehicle_path.add(Place(at_s, north_m, east_m, kind))
        target_m = target_of(tick.tick, self.follow_config) if state in FOLLOWED else None
        if target_m is not None:
            self.target_path.add(Place(at_s, *target_m, kind))

    # -- the rest -----------------------------------------------------------------------------------------

    def _frame(self, row: FrameRow) -> None:
        self.frames += 1
        self._tell(row.t_done_s - self.start_s, "video", row.problem or "")
        if row.problem:
            self.problems[row.problem] += 1
        if row.selection and row.result is not None and row.result.confidence is not None:
            self.confidence.add(row.t_capture_s - self.start_s, row.result.confidence)
        self.follow.frame(row)

    def _received(self, message: Received, t_s: float) -> None:
        at_s, is_alone = t_s - self.start_s, self._last is None
        for text in self.heard.add(message.data, t_s, state=is_alone):
            _keep(self.said, Words(text.t_s - self.start_s, "vehicle", text.text))
        vehicle = self.heard.vehicle
        if not is_alone:  # the decisions tell the rest
            return
        if vehicle.mode is not None:
            self._tell(at_s, "vehicle", f"{vehicle.mode}, {'armed' if vehicle.armed else 'disarmed'}")
        if vehicle.height_m is not None:
            self.height_m.add(at_s, vehicle.height_m)
        if vehicle.battery_frac is not None:
            self.battery.add(at_s, vehicle.battery_frac * 100)
        if vehicle.place_m is not None:
            self.vehicle_path.add(Place(at_s, *vehicle.place_m, "other"))

    def _ordered(self, order: Ordered, at_s: float) -> None:
        _keep(self.orders, Order(at_s, order.order, order.answer, order.refused))
        if order.refused:
            self._event(at_s, "operator", f"orders {order.order}: refused, {order.answer}")
        elif order.order.partition(" ")[0] not in _TAKEN_UP:
            self._event(at_s, "operator", f"orders {order.order}: {order.answer}")

    def _tell(self, at_s: float, kind: str, text: str) -> bool:
        """An event where it differs from the last of its kind; whether it did."""
        if self._told.get(kind, "") == text:
            return False
        self._told[kind] = text
        self._event(at_s, kind, text or "runs again")
        return True

    def _event(self, at_s: float, kind: str, text: str) -> None:
        if not _keep(self.events, Event(at_s, kind, text)):
            self.left_out += 1

    # -- results ------------------------------------------------------------------------------------------

    @property
    def knows_home(self) -> bool:
        """Whether the paths begin at home: as the decisions tell them they do."""
        return self._last is not None

    @property
    def ends_engaged(self) -> bool:
        """Whether the last message finds the vehicle still ours: no orderly end leaves that."""
        return self._last is not None and (self._last.output.engaging or self._last.output.state in FOLLOWED)

    @property
    def autopilot(self) -> str | None:
        """As its parameters say, or its heartbeat."""
        return self.link.audit.autopilot if self.link.audit is not None else self.heard.vehicle.autopilot


def _where(box: Box | None) -> str:
    """Its left upper corner, as orders and answers give it."""
    return "none" if box is None else "{2:.0f}x{3:.0f} px at {0:.0f},{1:.0f}".format(*box.xywh)


def _keep(lines: list[T], line: T) -> bool:
    """Add a line where there is still room; whether there was."""
    if len(lines) < _MOST:
        lines.append(line)
        return True
    return False
