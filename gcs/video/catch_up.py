"""From the frame an operator pointed at to the newest one: which of the frames between a tracker is shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gcs.video.frame import Frame

# Nobody can confirm sooner. The tracker that ships follows one box width a step: with 25 ms an update, a target of
# a width in three frames that was drawn a second ago.
CATCH_UP_S: Final = 0.5


def next_frame(waiting: Sequence[Frame], at_s: float, update_s: float, left_s: float) -> Frame | None:
    """The frame to track next, None where none waits; the steps are as small as the time left allows.

    waiting: frames later than the last one tracked, oldest first. at_s: arrival time of that last one. update_s: what
    one update takes. While the tracker works new frames come, so each step covers those as well as its part of what
    it is behind; when the time is up, half of what it is behind, for one great leap at the end would lose the target.
    """
    if not waiting:
        return None
    behind_s = waiting[-1].t_arrival_s - at_s
    updates_left = left_s / update_s if update_s > 0.0 else len(waiting)
    to_s = at_s + update_s + behind_s / max(updates_left, 2.0)
    return min(waiting, key=lambda frame: abs(frame.t_arrival_s - to_s))
