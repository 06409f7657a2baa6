"""A flight's messages, one after the other, to the figures of its report. Memory does not grow with what is skipped."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, fields
from typing import Final

from control.attitude import AttitudeBuffer, wrap_pi
from control.engagement import State
from control.gate_limits import TICK_S
from control.motion import distance_m
from control.types import Reason, VehicleMode
from gcs.audit import Audit, Level
from gcs.latency_budget import Budget
from gcs.link_meters import LinkFigures
from gcs.replay.log import Entry, FrameRow, TickRow
from gcs.report.figures import Audited, Event, Following, Link, Spread

_FOLLOWED: Final = (State.FOLLOWING, State.COASTING, State.LOST_HOLD)
_UNSEEN: Final = (State.COASTING, State.LOST_HOLD)
_STILL: Final = (Reason.PASSED, Reason.PRIMING, Reason.NO_REQUEST)  # the gate took nothing away
_TOTAL: Final = "total"
_MOST_EVENTS: Final = 500
_LONGEST_TICK_S: Final = 0.5  # a longer one is a pause, not time that was spent in a state


@dataclass(slots=True)
class Tally:
    """`add` each entry of a `FlightLog`."""

    start_s: float
    events: list[Event] = field(default_factory=list)
    frames: int = 0
    longest_pause_s: float = 0.0
    autopilot: str | None = None
    audit: Audited | None = None
    link: Link | None = None
    limits_s: Counter[str] = field(default_factory=Counter)
    problems: Counter[str] = field(default_factory=Counter)
    _last: TickRow | None = None
    _said: dict[str, str] = field(default_factory=dict)
    _seen_s: float = 0.0
    _unseen_s: float = 0.0
    _confirmations: int = 0
    _losses: int = 0
    _reacquired: int = 0
    _lost_since_s: float | None = None
    _longest_loss_s: float = 0.0
    _bearings_rad: list[float] = field(default_factory=list)
    _distances: list[float] = field(default_factory=list)
    _budgets: dict[str, list[float]] = field(default_factory=dict)
    _attitude: AttitudeBuffer = field(default_factory=AttitudeBuffer)
    _most_loss_frac: float = 0.0

    def add(self, entry: Entry) -> None:
        """One message."""
        t_s, _, message = entry
        if isinstance(message, TickRow):
            self._tick(message)
        elif isinstance(message, FrameRow):
            self._frame(message)
        elif isinstance(message, LinkFigures):
            self._link(message)
        elif isinstance(message, Audit):
            self._audit(t_s, message)

    # -- decisions ----------------------------------------------------------------------------------------

    def _tick(self, tick: TickRow) -> None:
        last, self._last = self._last, tick
        step_s = tick.t_s - last.t_s if last is not None else TICK_S
        self.longest_pause_s = max(self.longest_pause_s, step_s if last is not None else 0.0)
        step_s = min(max(step_s, 0.0), _LONGEST_TICK_S)
        self._acts(tick)
        self._changes(tick)
        self._look(tick)
        before = last.output.state if last is not None else None
        self._follow(tick, before, step_s)
        if tick.budget is not None:
            self._spent(tick.budget)

    def _changes(self, tick: TickRow) -> None:
        output, vehicle = tick.output, tick.inputs.vehicle
        name = "ENGAGING" if output.engaging else output.state.value.upper()
        why = "; ".join(cause.value for cause in output.reasons)
        self._tell(tick.t_s, "state", f"{name}: {why}" if why else name)
        if vehicle.mode is not VehicleMode.UNKNOWN:
            armed = "armed" if vehicle.armed else "disarmed"
            self._tell(tick.t_s, "vehicle", f"{vehicle.mode.value}, {armed}")

    def _acts(self, tick: TickRow) -> None:
        inputs = tick.inputs
        acts = (
            ("selects", inputs.select), ("confirms", inputs.confirm), ("aborts", inputs.abort),
            ("acknowledges", inputs.acknowledge),
        )  # fmt: skip
        for name, done in acts:
            if done:
                self._event(tick.t_s, "operator", name)

    def _look(self, tick: TickRow) -> None:
        """Where the camera looked, for the frames to come."""
        vehicle, gimbal = tick.inputs.vehicle, tick.camera
        if gimbal is not None:
            self._attitude.add(gimbal.t_s, 0.0, gimbal.pitch_rad, gimbal.yaw_rad)
        elif vehicle.attitude_t_s is not None:
            self._attitude.add(vehicle.attitude_t_s, vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad)

    def _follow(self, tick: TickRow, before: State | None, step_s: float) -> None:
        state = tick.output.state
        if state not in _FOLLOWED:
            if before in _FOLLOWED:
                self._lost_until(tick.t_s)
            return
        self._confirmations += before not in _FOLLOWED
        self._limits(tick, step_s)
        if state in _UNSEEN:
            self._unseen_s += step_s
            if self._lost_since_s is None:
                self._losses, self._lost_since_s = self._losses + 1, tick.t_s
            return
        self._seen_s += step_s
        self._reacquired += self._lost_since_s is not None
        self._lost_until(tick.t_s)
        held, target = tick.held, tick.target
        if held is not None and target is not None and held.mode.holds_distance and held.standoff_m > 0:
            self._distances.append(distance_m(held, target) / held.standoff_m - 1)

    def _lost_until(self, t_s: float) -> None:
        if self._lost_since_s is not None:
            self._longest_loss_s = max(self._longest_loss_s, t_s - self._lost_since_s)
            self._lost_since_s = None

    def _limits(self, tick: TickRow, step_s: float) -> None:
        for name in tick.request.limited_by if tick.request is not None else ():
            self.limits_s[name] += step_s  # type: ignore[assignment]
        if tick.gate not in _STILL:
            self.limits_s[f"gate, {tick.gate.value}"] += step_s  # type: ignore[assignment]

    def _spent(self, budget: Budget) -> None:
        for part in fields(Budget):
            self._budgets.setdefault(part.name.removesuffix("_s"), []).append(getattr(budget, part.name))
        self._budgets.setdefault(_TOTAL, []).append(budget.total_s)

    # -- the rest -----------------------------------------------------------------------------------------

    def _frame(self, row: FrameRow) -> None:
        self.frames += 1
        self._tell(row.t_done_s, "video", row.problem or "")
        if row.problem:
            self.problems[row.problem] += 1
        looking = self._attitude.at(row.t_capture_s)
        if self._last is None or self._last.output.state is not State.FOLLOWING:
            return
        if row.measurement is not None and looking is not None:
            self._bearings_rad.append(wrap_pi(row.measurement.azimuth_rad - looking[2]))

    def _link(self, figures: LinkFigures) -> None:
        self._most_loss_frac = max(self._most_loss_frac, figures.loss_frac)
        totals = figures.totals
        over_s = max((self._last.t_s if self._last is not None else 0.0) - self.start_s, 1.0)
        self.link = Link(
            received_kbps=totals.bytes_received / over_s / 1000,
            sent_kbps=totals.bytes_sent / over_s / 1000,
            most_loss_frac=self._most_loss_frac,
            bad_frames=figures.bad_frames,
            setpoints_sent=totals.setpoints_sent,
            dropped_late=totals.stale,
        )

    def _audit(self, t_s: float, audit: Audit) -> None:
        levels = Counter(finding.level for finding in audit.findings)
        said = tuple(
            f"{finding} ({'accepted' if finding.accepted else finding.level.value})"
            for finding in audit.findings
            if finding.level is not Level.FINE
        )
        self.autopilot = audit.autopilot
        self.audit = Audited(audit.autopilot, levels[Level.FINE], levels[Level.ADVICE], levels[Level.UNSAFE], said)

    def _tell(self, t_s: float, kind: str, text: str) -> None:
        """An event where it differs from the last of its kind."""
        if self._said.get(kind, "") != text:
            self._said[kind] = text
            self._event(t_s, kind, text or "runs again")

    def _event(self, t_s: float, kind: str, text: str) -> None:
        if len(self.events) < _MOST_EVENTS:
            self.events.append(Event(t_s - self.start_s, kind, text))

    @property
    def ends_engaged(self) -> bool:
        """Whether the last message finds the vehicle still ours: no orderly end leaves that."""
        return self._last is not None and (self._last.output.engaging or self._last.output.state in _FOLLOWED)

    # -- results ------------------------------------------------------------------------------------------

    def following(self) -> Following:
        """As far as the messages went."""
        if self._last is not None:
            self._lost_until(self._last.t_s)
        bearing_rad = _rms(self._bearings_rad)
        return Following(
            confirmations=self._confirmations,
            seen_s=self._seen_s,
            unseen_s=self._unseen_s,
            losses=self._losses,
            reacquired=self._reacquired,
            longest_loss_s=self._longest_loss_s,
            bearing_rms_deg=None if bearing_rad is None else math.degrees(bearing_rad),
            distance_rms_frac=_rms(self._distances),
        )

    def latency_ms(self) -> dict[str, Spread]:
        """By part, and in total."""
        return {name: _spread(values_s) for name, values_s in self._budgets.items()}


def _rms(values: list[float]) -> float | None:
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else None


def _spread(values_s: list[float]) -> Spread:
    ordered = sorted(values_s)
    return Spread(ordered[len(ordered) // 2] * 1000, ordered[min(len(ordered) - 1, int(0.95 * len(ordered)))] * 1000)
