"""What the camera says of its tracking: from the newest frame that went through the tracker."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from control.engagement import State
from gcs.audit import Audit
from gcs.flight_view import Sighting, Status
from gcs.operator.camera.messages import Corners, Tracking
from gcs.tick import Tick
from tracker.box import Box

LOST_S: Final = 3.0  # hidden for longer, and it is not taken for tracked any more
_OLD_S: Final = 1.0  # the newest frame; then the camera sees nothing
_ERROR_S: Final = 2.0  # so long a failure is shown, also to those who ask twice a second

IDLE: Final[tuple[Tracking, Corners | None]] = (Tracking.IDLE, None)


@dataclass(slots=True)
class TrackingView:
    """A `Watcher`; ask it for `now`."""

    size_px: tuple[int, int]
    _newest: Sighting | None = None
    _selection: int = 0
    _seen_s: float = -math.inf  # when the target was last visible, or was selected
    _failed_s: float = -math.inf

    def saw(self, sighting: Sighting) -> None:
        """A frame has been through the tracker."""
        seen = sighting.seen
        if seen.selection != self._selection:
            self._selection, self._seen_s = seen.selection, seen.t_done_s
            if seen.selection:
                self._failed_s = -math.inf
        if seen.result is not None and seen.result.visible:
            self._seen_s = seen.t_done_s
        if seen.selection and seen.problem is not None:
            self._failed_s = seen.t_done_s
        self._newest = sighting

    def ticked(self, tick: Tick) -> None:
        """Decisions are not the camera's."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nor is the audit."""

    def now(self, now_s: float, status: Status) -> tuple[Tracking, Corners | None]:
        """The state of the tracking, and where the target is or should be; None: nobody knows."""
        newest = self._newest
        if now_s - self._failed_s < _ERROR_S:
            return Tracking.ERROR, None
        if newest is None or not newest.seen.selection:
            return IDLE
        if now_s - newest.seen.t_done_s > _OLD_S:
            return Tracking.ERROR, None
        result = newest.seen.result
        if result is None:
            return IDLE
        if result.visible:
            return Tracking.ACTIVE, self._corners(result.box)
        if status.state is State.LOST_HOLD or now_s - self._seen_s > LOST_S:
            return IDLE
        return Tracking.ACTIVE | Tracking.COASTING, self._corners(newest.predicted or result.box)

    def _corners(self, box: Box) -> Corners | None:
        if not box.is_valid:
            return None
        width, height = self.size_px
        x, y, w, h = box.xywh
        return _frac(x / width), _frac(y / height), _frac((x + w) / width), _frac((y + h) / height)


def _frac(value: float) -> float:
    return min(max(value, 0.0), 1.0)
