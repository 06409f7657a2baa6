"""What stands on the page, of what a station knows."""

from __future__ import annotations

import math

from control.engagement import State
from control.fence import Fence
from gcs.flight_view import Sighting, Status
from gcs.latency_budget import Budget
from gcs.operator.playback import Playback
from gcs.operator.station import Point, Scene, Station
from gcs.operator.web.report_types import (
    CandidateReport,
    CandidatesReport,
    EventReport,
    FenceReport,
    FrameReport,
    MapReport,
    PlayheadReport,
    StatusReport,
    StretchReport,
    TimelineReport,
    VehicleReport,
)
from tracker.box import Box


def frame_report(sighting: Sighting) -> FrameReport:
    """One frame."""
    seen = sighting.seen
    result = seen.result
    return FrameReport(
        frame=seen.frame.seq,
        t_s=float(seen.frame.t_arrival_s),
        box=_xywh(result.box) if result is not None else None,
        visible=result is not None and bool(result.visible),
        predicted=_xywh(sighting.predicted) if sighting.predicted is not None else None,
        confidence=round(float(result.confidence), 3) if result is not None else None,
        selection=seen.selection,
    )


def status_report(station: Station, controller: str, viewers: int) -> StatusReport:
    """Everything beside the picture, for who is not in control."""
    status = station.status()
    return StatusReport(
        t_s=status.t_s,
        state=status.state.value,
        engaging=status.engaging,
        tone=status.tone.value,
        headline=status.headline,
        reasons=status.reasons,
        refusals=station.refusals() if status.state is State.SELECTED and not status.engaging else (),
        confidence=_rounded(status.confidence, 3),
        distance_m=_rounded(status.distance_m, 2),
        standoff_m=_rounded(status.standoff_m, 2),
        mode=status.follow_mode.value,
        limits=status.limited_by,
        latency=_latency(status.budget),
        fps=round(float(status.video_fps), 1),
        vehicle=_vehicle(status),
        ages_s=_ages(status),
        link=status.link,
        warnings=status.warnings,
        controller=controller,
        in_control=False,
        viewers=viewers,
        recording=status.recording,
        selection=status.selection,
    )


def map_report(scene: Scene) -> MapReport:
    """The map."""
    return MapReport(
        vehicle_m=_point(scene.vehicle_m),
        yaw_rad=round(float(scene.yaw_rad), 3),
        target_m=_point(scene.target_m),
        fence=_fence(scene.fence) if scene.fence is not None else None,
        vehicle_path_m=_path(scene.vehicle_path_m),
        target_path_m=_path(scene.target_path_m),
    )


def candidates_report(station: Station) -> CandidatesReport:
    """What could be selected."""
    return CandidatesReport(boxes=[CandidateReport(each.number, _xywh(each.box)) for each in station.candidates()])


def timeline_report(station: Playback) -> TimelineReport:
    """What a recording has to show."""
    timeline = station.timeline()
    return TimelineReport(
        span_s=round(timeline.span_s, 3),
        stretches=[StretchReport(round(s.begin_s, 3), round(s.end_s, 3), s.state) for s in timeline.stretches],
        events=[EventReport(round(e.t_s, 3), e.kind.value, e.text) for e in timeline.events],
    )


def playhead_report(station: Playback) -> PlayheadReport:
    """Where a recording stands."""
    head = station.playhead()
    return PlayheadReport(
        t_s=round(head.t_s, 3),
        playing=head.is_playing,
        ended=head.has_ended,
        speed=head.speed,
        frame=head.frame,
        unix_s=_rounded(head.unix_s, 3),
    )


def _xywh(box: Box) -> tuple[float, ...]:
    return tuple(round(float(value), 1) for value in box.xywh)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(float(value), digits)


def _vehicle(status: Status) -> VehicleReport:
    vehicle = status.vehicle
    known, levelled = vehicle.position_t_s is not None, vehicle.attitude_t_s is not None
    return VehicleReport(
        mode=vehicle.mode.value,
        armed=vehicle.armed,
        in_air=vehicle.in_air,
        height_m=round(float(vehicle.height_m), 2) if known else None,
        speed_mps=round(math.hypot(*vehicle.velocity_ned_mps), 2) if known else None,
        battery_frac=_rounded(vehicle.battery_frac, 3),
        yaw_rad=round(float(vehicle.yaw_rad), 3) if levelled else None,
    )


def _ages(status: Status) -> dict[str, float | None]:
    vehicle = status.vehicle
    heard_s = {
        "video": status.frame_t_s,
        "heartbeat": vehicle.heartbeat_t_s,
        "attitude": vehicle.attitude_t_s,
        "position": vehicle.position_t_s,
    }
    return {name: None if t_s is None else round(max(0.0, status.t_s - t_s), 2) for name, t_s in heard_s.items()}


def _latency(budget: Budget | None) -> dict[str, float] | None:
    if budget is None:
        return None
    parts_s = {
        "total_ms": budget.total_s,
        "glass": budget.glass_s,
        "decode": budget.decode_s,
        "wait": budget.wait_s,
        "tracker": budget.track_s,
        "control": budget.control_s,
        "link": budget.link_s,
    }
    return {name: round(part_s * 1000, 1) for name, part_s in parts_s.items()}


def _fence(fence: Fence) -> FenceReport:
    return FenceReport(
        north_m=fence.north_m,
        east_m=fence.east_m,
        radius_m=fence.radius_m,
        polygon_m=fence.polygon_m,
        operator_m=(fence.operator_north_m, fence.operator_east_m),
        operator_distance_m=fence.operator_distance_m,
    )


def _point(point_m: Point | None) -> Point | None:
    return None if point_m is None else (round(float(point_m[0]), 2), round(float(point_m[1]), 2))


def _path(path_m: tuple[Point, ...]) -> tuple[Point, ...]:
    return tuple((round(float(north_m), 1), round(float(east_m), 1)) for north_m, east_m in path_m)
