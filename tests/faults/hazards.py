"""The hazard table: what is broken, what must come of it, and within which bound."""

from __future__ import annotations

from typing import Final

from tests.faults import break_video as video
from tests.faults.script import Expect, Fault

VIDEO: Final = (
    Fault(1, "video lost", Expect.RELEASED, video.video_lost, 1.05, watch_s=6.0),
    Fault(2, "picture stands still", Expect.RELEASED, video.video_still, 1.1, watch_s=6.0),
    Fault(3, "pictures old", Expect.RELEASED, video.pictures_old, 1.05, watch_s=6.0),
    Fault(4, "drift to something else", Expect.SAFE, video.drift_away, watch_s=4.0),
    Fault(5, "box jumps for good", Expect.SAFE, video.box_jumps, watch_s=5.0),
    Fault(5, "box jumps and returns", Expect.GOES_ON, video.box_jumps_back, watch_s=4.0),
    Fault(6, "box absurd", Expect.RELEASED, video.box_absurd, 1.05, watch_s=6.0),
    Fault(6, "score absurd", Expect.RELEASED, video.score_absurd, 1.05, watch_s=6.0),
    Fault(7, "target leaves the picture", Expect.RELEASED, video.target_leaves, 1.05, watch_s=6.0),
    Fault(8, "hidden for good", Expect.RELEASED, video.hidden_long, 1.05, watch_s=6.0),
    Fault(8, "hidden briefly", Expect.GOES_ON, video.hidden_briefly),
    Fault(9, "picture mirrored", Expect.RELEASED, video.camera_mirrored, 1.5, from_start=True, watch_s=6.0),
    Fault(9, "camera upside down", Expect.RELEASED, video.camera_rolled, 1.5, from_start=True, watch_s=6.0),
    Fault(20, "target comes at the vehicle", Expect.SAFE, video.target_comes, watch_s=4.0),
    Fault(33, "pictures damaged", Expect.RELEASED, video.pictures_broken, 1.05, watch_s=6.0),
    Fault(39, "tracker fails", Expect.RELEASED, video.tracker_fails, 1.05, watch_s=6.0),
    Fault(39, "tracker slow", Expect.RELEASED, video.tracker_slow, 1.05, watch_s=6.0),
)

FAULTS: Final = VIDEO
