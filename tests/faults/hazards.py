"""The hazard table: what is broken, what must come of it, and within which bound."""

from __future__ import annotations

from typing import Final

from tests.faults import break_link as link
from tests.faults import break_station as station
from tests.faults import break_vehicle as vehicle
from tests.faults import break_video as video
from tests.faults.script import Expect, Fault

VIDEO: Final = (
    Fault(1, "video lost", Expect.RELEASED, video.video_lost, 1.05, watch_s=4.6),
    Fault(2, "picture stands still", Expect.RELEASED, video.video_still, 1.1, watch_s=4.6),
    Fault(3, "pictures old", Expect.RELEASED, video.pictures_old, 1.05, watch_s=4.6),
    Fault(4, "drift to something else", Expect.SAFE, video.drift_away, watch_s=4.0),
    Fault(5, "box jumps for good", Expect.SAFE, video.box_jumps, watch_s=5.0),
    Fault(5, "box jumps and returns", Expect.GOES_ON, video.box_jumps_back, watch_s=4.0),
    Fault(6, "box absurd", Expect.RELEASED, video.box_absurd, 1.05, watch_s=4.6),
    Fault(6, "score absurd", Expect.RELEASED, video.score_absurd, 1.05, watch_s=4.6),
    Fault(7, "target leaves the picture", Expect.RELEASED, video.target_leaves, 1.05, watch_s=4.6),
    Fault(8, "hidden for good", Expect.RELEASED, video.hidden_long, 1.05, watch_s=4.6),
    Fault(8, "hidden briefly", Expect.GOES_ON, video.hidden_briefly),
    # 3 s of seeing it; while the target is hidden meanwhile, nothing can be told of the camera.
    Fault(9, "picture mirrored", Expect.RELEASED, video.camera_mirrored, 4.2, from_start=True, watch_s=7.0),
    Fault(9, "camera upside down", Expect.RELEASED, video.camera_rolled, 4.2, from_start=True, watch_s=7.0),
    Fault(20, "target comes at the vehicle", Expect.SAFE, video.target_comes, watch_s=4.0),
    Fault(33, "pictures damaged", Expect.RELEASED, video.pictures_broken, 1.05, watch_s=4.6),
    Fault(39, "tracker fails", Expect.RELEASED, video.tracker_fails, 1.05, watch_s=4.6),
    Fault(39, "tracker slow", Expect.RELEASED, video.tracker_slow, 1.05, watch_s=4.6),
)

LINK: Final = (
    Fault(10, "link down", Expect.ENDED, link.link_down, 0.55, watch_s=5.0),
    Fault(11, "it does not hear us", Expect.ENDED, link.uplink_down, 1.5, watch_s=5.0),
    Fault(12, "we do not hear it", Expect.ENDED, link.downlink_down, 0.55, watch_s=4.0),
    Fault(13, "loss, delay, duplicates, overtaking", Expect.SAFE, link.link_bad, watch_s=5.0),
    Fault(28, "attitude stops", Expect.RELEASED, link.attitude_stops, 0.55, watch_s=3.5),
    Fault(28, "position stops", Expect.RELEASED, link.position_stops, 0.55, watch_s=3.5),
    Fault(28, "heartbeat and mode stop", Expect.ENDED, link.heartbeat_stops, 3.05, watch_s=7.0),
    Fault(29, "somebody else steers too", Expect.RELEASED, link.foreign_setpoints, 1.5, watch_s=4.0),
    Fault(29, "somebody else listens", Expect.GOES_ON, link.foreign_heartbeats),
    Fault(29, "somebody else commands", Expect.TAKEN_OVER, link.foreign_command, 0.15),
    Fault(30, "a second vehicle", Expect.GOES_ON, link.second_vehicle, watch_s=3.5),
    Fault(31, "forged: the mode is ours", Expect.TAKEN_OVER, link.forged_mode, 0.15, link.signed, watch_s=4.0),
    Fault(31, "replayed: the mode is ours", Expect.TAKEN_OVER, link.replayed_mode, 0.15, link.signed, watch_s=4.0),
    Fault(32, "garbage on the link", Expect.GOES_ON, link.garbage),
)
VEHICLE: Final = (
    Fault(6, "telemetry not a number", Expect.RELEASED, vehicle.telemetry_nan, 0.55, watch_s=3.5),
    Fault(14, "external control refused", Expect.REFUSED, vehicle.external_refused, 0.0, from_start=True),
    Fault(14, "hold refused", Expect.ENDED, vehicle.hold_refused, 0.05, watch_s=5.0),
    Fault(15, "pilot takes over", Expect.TAKEN_OVER, vehicle.pilot_takes_over, 0.1),
    Fault(16, "pilot moves the sticks", Expect.TAKEN_OVER, vehicle.pilot_moves_sticks, 0.1),
    Fault(17, "vehicle's failsafe", Expect.TAKEN_OVER, vehicle.failsafe, 0.1),
    Fault(
        18, "target runs past the fence", Expect.SAFE, vehicle.to_the_fence, prepare=vehicle.small_fence, watch_s=6.0
    ),
    Fault(19, "climb or descent for good", Expect.SAFE, vehicle.height_asked, None, vehicle.low_ceiling, watch_s=5.0),
    Fault(19, "height unknown", Expect.RELEASED, link.height_stops, 0.55, watch_s=3.5),
    Fault(26, "battery low before", Expect.REFUSED, vehicle.battery_low_before, 0.0, from_start=True),
    Fault(26, "battery low in flight", Expect.TAKEN_OVER, vehicle.low_battery, 0.1, watch_s=3.5),
    Fault(27, "position lost", Expect.ENDED, vehicle.gps_lost, 0.55, watch_s=4.0),
    Fault(38, "operator errs", Expect.REFUSED, vehicle.operator_errs, 0.0, from_start=True),
)
STATION: Final = (
    Fault(21, "control gives old answers", Expect.RELEASED, station.requests_stale, 0.25, watch_s=4.0),
    Fault(21, "control raises", Expect.CRASHED, station.law_raises, 0.05, watch_s=4.0),
    Fault(22, "process stands still", Expect.ENDED, station.long_stall, 0.01, watch_s=4.0),
    Fault(22, "process late for a moment", Expect.GOES_ON, station.short_stall),
    Fault(23, "process gone", Expect.GONE, station.killed, 0.0, watch_s=5.0),
    Fault(24, "program ends in order", Expect.ENDED, station.leaves, 0.05, watch_s=3.0),
    Fault(25, "wall clock jumps", Expect.GOES_ON, station.clock_jumps),
    Fault(35, "disk full", Expect.GOES_ON, station.disk_full),
    Fault(37, "operator aborts", Expect.RELEASED, station.operator_stops, 0.01),
)
FAULTS: Final = tuple(sorted((*VIDEO, *LINK, *VEHICLE, *STATION), key=lambda fault: fault.hazard))

# What cannot be done on a fake clock, and where it is done.
ELSEWHERE: Final = {
    34: "configurations and weights are refused before a flight begins: tests/fuzz, tests/gcs/test_config.py",
    36: "memory and handles grow in real time only: make soak",
    40: "a dry run has no link to break: tests/gcs/test_dryrun_sockets.py",
}
