"""What following came to: how long, how near, what was lost and found again, and which limits clipped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from control.attitude import AttitudeBuffer, wrap_pi
from control.engagement import State
from control.motion import distance_m
from control.types import Reason
from gcs.replay.log import FrameRow, TickRow
from gcs.report.figures import Clipped, Follow, Following, Loss
from gcs.report.sampling import Curve, Rms, Stretches

FOLLOWED: Final = (State.FOLLOWING, State.COASTING, State.LOST_HOLD)
UNSEEN: Final = (State.COASTING, State.LOST_HOLD)
_STILL: Final = (Reason.PASSED, Reason.PRIMING, Reason.NO_REQUEST)  # the gate took nothing away
_MOST: Final = 500  # follows, and losses, that are kept one by one
_HIDDEN_S: Final = 0.5  # the picture of a loss is of so long after it began


@dataclass(slots=True)
class Episode:
    """A follow, with the frame that was the newest when it began."""

    start_s: float
    mode: str
    standoff_m: float | None
    frame: FrameRow | None
    end_s: float | None = None
    ended: str = ""


@dataclass(slots=True)
class Missing:
    """A loss, with the frames it is shown by: the last that showed the target, one without it, the first again."""

    start_s: float
    seen: FrameRow | None
    hidden: FrameRow | None = None
    again: FrameRow | None = None
    end_s: float | None = None
    found: bool = False

    @property
    def loss(self) -> Loss:
        """In figures."""
        return Loss(self.start_s, self.start_s if self.end_s is None else self.end_s, self.found)


@dataclass(slots=True)
class FollowTally:
    """start_s: reading of the flight's clock at the first message; all it gives is told from then on.

    mount_yaw_rad: of the camera in the vehicle; 0 where a gimbal turns it.
    """

    start_s: float
    mount_yaw_rad: float = 0.0
    episodes: list[Episode] = field(default_factory=list)
    missing: list[Missing] = field(default_factory=list)
    bearing_deg: Curve = field(default_factory=Curve)
    distance_m: Curve = field(default_factory=Curve)
    standoff_m: Curve = field(default_factory=Curve)
    excess_m: Curve = field(default_factory=Curve)
    clipped: dict[str, Stretches] = field(default_factory=dict)
    seen_s: float = 0.0
    unseen_s: float = 0.0
    confirmations: int = 0
    losses: int = 0
    reacquired: int = 0
    longest_loss_s: float = 0.0
    _attitude: AttitudeBuffer = field(default_factory=AttitudeBuffer)
    _bearing_rad: Rms = field(default_factory=Rms)
    _distance_frac: Rms = field(default_factory=Rms)
    _episode: Episode | None = None
    _missing: Missing | None = None
    _newest: FrameRow | None = None
    _shown: FrameRow | None = None  # the newest frame with a measurement
    _sent_s: float | None = None
    _longest_gap_s: float | None = None

    def tick(self, tick: TickRow, step_s: float) -> None:
        """A decision; step_s: since the one before."""
        self._look(tick)
        if tick.output.state not in FOLLOWED:
            self._end(tick)
            return
        if self._episode is None:
            self._begin(tick)
        self._limits(tick, step_s)
        self._setpoint(tick)
        self._distance(tick)
        if tick.output.state in UNSEEN:
            self.unseen_s += step_s
            self._lost(tick.t_s - self.start_s)
        else:
            self.seen_s += step_s
            self._found(tick.t_s - self.start_s, by_itself=True)

    def frame(self, row: FrameRow) -> None:
        """A frame and what the tracker said of it."""
        self._newest = row
        missing = self._missing
        if missing is not None and (
            missing.hidden is None or row.t_done_s - self.start_s < missing.start_s + _HIDDEN_S
        ):
            missing.hidden = row
        if row.measurement is None:
            return
        self._shown = row
        looking = self._attitude.at(row.t_capture_s)
        if looking is not None and self._episode is not None and missing is None:
            off_rad = wrap_pi(row.measurement.azimuth_rad - looking[2])
            self._bearing_rad.add(off_rad)
            self.bearing_deg.add(row.t_capture_s - self.start_s, math.degrees(off_rad))

    def finish(self, t_s: float) -> None:
        """The messages end here, whatever was going on; t_s: as in `figures`."""
        self._found(t_s, by_itself=False)
        if self._episode is not None:
            self._episode.end_s, self._episode.ended = t_s, "where the record ends"

    def _look(self, tick: TickRow) -> None:
        """Where the camera looked, for the frames to come."""
        vehicle, gimbal = tick.inputs.vehicle, tick.camera
        if gimbal is not None:
            self._attitude.add(gimbal.t_s, 0.0, gimbal.pitch_rad, gimbal.yaw_rad)
        elif vehicle.attitude_t_s is not None:
            yaw_rad = vehicle.yaw_rad + self.mount_yaw_rad
            self._attitude.add(vehicle.attitude_t_s, vehicle.roll_rad, vehicle.pitch_rad, yaw_rad)

    def _begin(self, tick: TickRow) -> None:
        self.confirmations += 1
        held = tick.held
        standoff_m = held.standoff_m if held is not None and held.mode.holds_distance else None
        mode = "" if held is None else held.mode.value
        self._episode = Episode(tick.t_s - self.start_s, mode, standoff_m, self._shown or self._newest)
        if len(self.episodes) < _MOST:
            self.episodes.append(self._episode)

    def _end(self, tick: TickRow) -> None:
        self._sent_s = None
        if self._episode is None:
            return
        t_s = tick.t_s - self.start_s
        self._found(t_s, by_itself=False)
        said = "; ".join(cause.value for cause in tick.output.reasons)
        self._episode.end_s = t_s
        state = tick.output.state.value.upper()
        self._episode.ended = f"with {state}: {said}" if said else f"with {state}"
        self._episode = None

    def _lost(self, t_s: float) -> None:
        if self._missing is None:
            self.losses += 1
            self._missing = Missing(t_s, self._shown)
            if len(self.missing) < _MOST:
                self.missing.append(self._missing)

    def _found(self, t_s: float, *, by_itself: bool) -> None:
        missing, self._missing = self._missing, None
        if missing is None:
            return
        missing.end_s = t_s
        self.longest_loss_s = max(self.longest_loss_s, t_s - missing.start_s)
        if by_itself:
            self.reacquired += 1
            missing.found, missing.again = True, self._shown

    def _limits(self, tick: TickRow, step_s: float) -> None:
        names = list(tick.request.limited_by) if tick.request is not None else []
        if tick.gate not in _STILL:
            names.append(f"gate, {tick.gate.value}")
        t_s = tick.t_s - self.start_s
        for name in names:
            self.clipped.setdefault(name, Stretches()).add(t_s - step_s, t_s)

    def _setpoint(self, tick: TickRow) -> None:
        if tick.setpoint is None:
            return
        if self._sent_s is not None:
            self._longest_gap_s = max(self._longest_gap_s or 0.0, tick.setpoint.t_s - self._sent_s)
        self._sent_s = tick.setpoint.t_s

    def _distance(self, tick: TickRow) -> None:
        held, target = tick.held, tick.target
        if held is None or target is None or not held.mode.holds_distance or held.standoff_m <= 0:
            return
        t_s, away_m = tick.t_s - self.start_s, distance_m(held, target)
        self.distance_m.add(t_s, away_m)
        self.standoff_m.add(t_s, held.standoff_m)
        if tick.output.state not in UNSEEN:
            self.excess_m.add(t_s, away_m - held.standoff_m)
            self._distance_frac.add(away_m / held.standoff_m - 1)

    # -- results ------------------------------------------------------------------------------------------

    @property
    def ends_engaged(self) -> bool:
        """Whether the vehicle is still ours."""
        return self._episode is not None

    def following(self) -> Following:
        """In figures."""
        bearing_rad = self._bearing_rad.value
        return Following(
            confirmations=self.confirmations,
            seen_s=self.seen_s,
            unseen_s=self.unseen_s,
            losses=self.losses,
            reacquired=self.reacquired,
            longest_loss_s=self.longest_loss_s,
            bearing_rms_deg=None if bearing_rad is None else math.degrees(bearing_rad),
            distance_rms_frac=self._distance_frac.value,
            longest_gap_s=self._longest_gap_s,
        )

    def follows(self) -> Iterable[Follow]:
        """One by one; call `finish` before."""
        for one in self.episodes:
            yield Follow(one.start_s, one.end_s or one.start_s, one.mode, one.standoff_m, one.ended)

    def limits(self) -> Iterable[Clipped]:
        """The longest first."""
        for name, spans in sorted(self.clipped.items(), key=lambda item: -item[1].total_s):
            yield Clipped(name, spans.total_s, tuple(spans.spans))
