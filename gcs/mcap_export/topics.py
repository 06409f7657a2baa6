"""The messages of a flight as topics: what Foxglove draws by itself, and all else to be plotted."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from control.camera import CameraModel, ned_from_camera
from control.config import FollowConfig
from control.geolocation import moved_deg, target_fix
from control.types import Vec3, VelocityRequest
from gcs.audit import Audit
from gcs.flight_view import target_distance_m
from gcs.link_meters import LinkFigures
from gcs.map_paths import target_of
from gcs.mcap_export.boxes import drawn_boxes
from gcs.mcap_export.frames import CAMERA, HOME, VEHICLE, camera_rotation, enu, upright, vehicle_rotation
from gcs.mcap_export.mavlink import MavlinkTopics, put_place
from gcs.mcap_export.messages import Decision, Latency, Setpoint, TrackedFrame
from gcs.mcap_export.video import FilmTopics
from gcs.mcap_export.writer import TopicWriter
from gcs.recorder.events import Expected, Ordered, Received, Refusals, Said, Selected
from gcs.replay.log import Entry, FrameRow, Sent, TickRow
from gcs.statustext import StatusText

_AS_THEY_ARE: Final[dict[type, str]] = {
    Audit: "/audit", LinkFigures: "/link", Refusals: "/refusals", Selected: "/selection", Expected: "/expected",
    Ordered: "/orders",
}  # fmt: skip
_INFO, _WARNING, _ERROR = 2, 3, 4  # foxglove.LogLevel
_CALIBRATION_S: Final = 1.0


class FlightTopics:
    """Give it each entry of a `FlightLog`, in order. camera: as the station was told, None where it is not known."""

    def __init__(self, writer: TopicWriter, film: FilmTopics, follow: FollowConfig, camera: CameraModel | None) -> None:
        self._writer = writer
        self._film = film
        self._follow = follow
        self._camera = camera
        self._mavlink = MavlinkTopics(writer, self._vehicle_said)
        self._headline = ""
        self._calibration_due_s = -math.inf

    def add(self, entry: Entry) -> None:
        """One message."""
        t_s, frame, message = entry
        if isinstance(message, Received):
            self._mavlink.add(t_s, message.data)
        elif isinstance(message, TickRow):
            self._tick(message)
        elif isinstance(message, FrameRow):
            self._frame(t_s, frame, message)
        elif isinstance(message, Said):
            self._log(t_s, _INFO, "station", message.text)
        elif (topic := _AS_THEY_ARE.get(type(message))) is not None:
            self._writer.put_own(topic, t_s, message)
            if isinstance(message, Ordered):
                level = _WARNING if message.refused else _INFO
                self._log(t_s, level, "operator", f"{message.order}: {message.answer}")
            elif isinstance(message, Refusals) and message.reasons:
                self._log(t_s, _INFO, "refusals", "; ".join(message.reasons))

    # -- decisions -----------------------------------------------------------------------------------------

    def _tick(self, row: TickRow) -> None:
        t_s, vehicle, writer = row.t_s, row.inputs.vehicle, self._writer
        away_m = target_distance_m(row.target, vehicle, row.held, self._follow)
        writer.put_own("/state", t_s, Decision.of(row, away_m))
        writer.put_own("/vehicle/state", t_s, vehicle)
        if row.target is not None:
            writer.put_own("/target/state", t_s, row.target)
        if row.request is not None:
            writer.put_own("/request", t_s, _setpoint(row.request))
        if row.setpoint is not None:
            writer.put_own("/setpoint", t_s, _setpoint(row.setpoint))
        if row.budget is not None:
            writer.put_own("/latency", t_s, Latency.of(row.budget))
        self._say_state(row)
        self._place(row)
        self._target(row, away_m)

    def _say_state(self, row: TickRow) -> None:
        name = "ENGAGING" if row.output.engaging else row.output.state.value.upper()
        headline = ": ".join(filter(None, (name, "; ".join(cause.value for cause in row.output.reasons))))
        if headline != self._headline:
            self._headline = headline
            self._log(row.t_s, _WARNING if row.output.reasons else _INFO, "state", headline)

    def _place(self, row: TickRow) -> None:
        vehicle = row.inputs.vehicle
        if vehicle.attitude_t_s is None:
            return
        attitude = vehicle.roll_rad, vehicle.pitch_rad, vehicle.yaw_rad
        where = vehicle.position_ned_m if vehicle.position_t_s is not None else (0.0, 0.0, 0.0)
        self._transform(row.t_s, VEHICLE, where, vehicle_rotation(attitude))
        camera = self._camera
        if camera is None:
            return
        if row.camera is not None:  # on a gimbal, which says where it looks
            camera, attitude = (
                replace(camera, mount_rpy_rad=(0.0, 0.0, 0.0)),
                (0.0, row.camera.pitch_rad, row.camera.yaw_rad),
            )
        self._transform(row.t_s, CAMERA, where, camera_rotation(ned_from_camera(camera, attitude)))
        if row.t_s >= self._calibration_due_s:
            self._calibration_due_s = row.t_s + _CALIBRATION_S
            self._calibration(row.t_s, camera)

    def _transform(self, t_s: float, child: str, ned_m: Vec3, rotation: dict[str, float]) -> None:
        transform = {
            "timestamp": self._writer.stamp(t_s), "parent_frame_id": HOME, "child_frame_id": child,
            "translation": enu(ned_m), "rotation": rotation,
        }  # fmt: skip
        self._writer.put_foxglove("/tf", "foxglove.FrameTransform", t_s, transform)

    def _calibration(self, t_s: float, camera: CameraModel) -> None:
        fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
        message = {
            "timestamp": self._writer.stamp(t_s), "frame_id": CAMERA,
            "width": camera.width_px, "height": camera.height_px,
            "distortion_model": "plumb_bob", "D": camera.distortion,
            "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        }  # fmt: skip
        self._writer.put_foxglove("/camera/calibration", "foxglove.CameraCalibration", t_s, message)

    def _target(self, row: TickRow, away_m: float | None) -> None:
        """Where it is, at its own height; on a map, where the vehicle has told its place."""
        if row.target is None or away_m is None or target_of(row.tick, self._follow) is None:
            return
        fix = target_fix(row.target, away_m)
        if fix is None:
            return
        north_m, east_m, down_m = fix.offset_ned_m
        at = tuple(map(sum, zip(row.inputs.vehicle.position_ned_m, fix.offset_ned_m, strict=True)))
        pose = {"position": enu(at), "orientation": upright()}  # type: ignore[arg-type]
        message = {"timestamp": self._writer.stamp(row.t_s), "frame_id": HOME, "pose": pose}
        self._writer.put_foxglove("/target/pose", "foxglove.PoseInFrame", row.t_s, message)
        if self._mavlink.place is not None:
            latitude_deg, longitude_deg, altitude_m = self._mavlink.place
            place_deg = moved_deg((latitude_deg, longitude_deg), (north_m, east_m))
            put_place(self._writer, "/target/location", row.t_s, (*place_deg, altitude_m - down_m))

    # -- frames and words ----------------------------------------------------------------------------------

    def _frame(self, t_s: float, seq: int | None, row: FrameRow) -> None:
        self._writer.put_own("/camera/frame", t_s, TrackedFrame.of(seq, row))
        shown = drawn_boxes(row, self._writer.stamp(self._film.shown_s(row)))
        self._writer.put_foxglove("/camera/boxes", "foxglove.ImageAnnotations", t_s, shown)

    def _vehicle_said(self, t_s: float, text: StatusText) -> None:
        level = _ERROR if text.severity <= 3 else _WARNING if text.severity == 4 else _INFO
        self._log(t_s, level, "vehicle", text.text)

    def _log(self, t_s: float, level: int, name: str, text: str) -> None:
        message: dict[str, Any] = {
            "timestamp": self._writer.stamp(t_s), "level": level, "message": text, "name": name, "file": "", "line": 0,
        }  # fmt: skip
        self._writer.put_foxglove("/log", "foxglove.Log", t_s, message)


def _setpoint(wanted: VelocityRequest | Sent) -> Setpoint:
    north, east, _ = wanted.velocity_ned_mps
    return Setpoint(wanted.velocity_ned_mps, wanted.yaw_rate_rps, math.hypot(north, east))
