"""What there is to say of the camera and its target now, each as the message that says it. No I/O."""

from __future__ import annotations

from collections.abc import Callable, Set
from typing import TypeAlias

from gcs.flight_view import Status
from gcs.framing import Message
from gcs.operator.camera import messages
from gcs.operator.camera.messages import Flag
from gcs.operator.camera.setup import CameraSetup, TargetPlace
from gcs.operator.camera.view import TrackingView
from gcs.operator.station import Station

Where: TypeAlias = Callable[[], TargetPlace | None]


class Facts:
    """where: the target's place, None where it cannot be told; without it the camera does not claim to know."""

    def __init__(
        self, setup: CameraSetup, station: Station, view: TrackingView, now_s: float, where: Where | None
    ) -> None:
        self._setup = setup
        self._station = station
        self._view = view
        self._where = where
        self._started_s = now_s
        self._filming_since_s: float | None = None
        self._makers: dict[int, Callable[[float], Message | None]] = {
            messages.HEARTBEAT: lambda now_s: messages.heartbeat(),
            messages.INFORMATION: self._information,
            messages.SETTINGS: lambda now_s: messages.settings(self._time_ms(now_s)),
            messages.STORAGE: lambda now_s: messages.storage(self._time_ms(now_s)),
            messages.CAPTURE: self._capture_status,
            messages.STREAM: self._stream,
            messages.STREAM_STATUS: self._stream_status,
            messages.FOV: self._fov_status,
            messages.IMAGE_STATUS: self._image_status,
            messages.GEO_STATUS: self._geo_status,
        }

    @property
    def known(self) -> Set[int]:
        """Ids of the messages that a camera may have."""
        return self._makers.keys()

    def message(self, message_id: int, now_s: float) -> Message | None:
        """The message of this id, as of now; None: this camera has none."""
        maker = self._makers.get(message_id)
        return None if maker is None else maker(now_s)

    def _information(self, now_s: float) -> Message:
        flags = Flag.HAS_TRACKING_POINT | Flag.HAS_TRACKING_RECTANGLE
        if self._setup.stream_url:
            flags |= Flag.HAS_VIDEO_STREAM
        if self._where is not None:
            flags |= Flag.HAS_TRACKING_GEO_STATUS
        if self._station.status().recording is not None:
            flags |= Flag.CAPTURE_VIDEO
        return messages.information(self._setup, self._time_ms(now_s), self._station.size, flags)

    def _capture_status(self, now_s: float) -> Message:
        self.note_filming(self._station.status(), now_s)
        since_s = self._filming_since_s
        filming_ms = 0 if since_s is None else int((now_s - since_s) * 1000)
        return messages.capture_status(self._time_ms(now_s), since_s is not None, filming_ms)

    def note_filming(self, status: Status, now_s: float) -> None:
        """Called often enough, the length of a film can be told."""
        if not status.recording:
            self._filming_since_s = None
        elif self._filming_since_s is None:
            self._filming_since_s = now_s

    def _stream(self, now_s: float) -> Message | None:
        if not self._setup.stream_url:
            return None
        station = self._station
        return messages.stream_information(self._setup, station.size, station.status().video_fps, station.hfov_rad)

    def _stream_status(self, now_s: float) -> Message | None:
        if not self._setup.stream_url:
            return None
        station = self._station
        return messages.stream_status(self._setup, station.size, station.status().video_fps, station.hfov_rad)

    def _fov_status(self, now_s: float) -> Message:
        return messages.fov_status(self._time_ms(now_s), self._station.size, self._station.hfov_rad)

    def _image_status(self, now_s: float) -> Message:
        rendered = self._setup.rendered and self._setup.stream_url is not None
        return messages.image_status(*self._view.now(now_s, self._station.status()), rendered)

    def _geo_status(self, now_s: float) -> Message | None:
        if self._where is None:
            return None
        tracking, corners = self._view.now(now_s, self._station.status())
        return messages.geo_status(tracking, self._where() if corners is not None else None)

    def _time_ms(self, now_s: float) -> int:
        return int((now_s - self._started_s) * 1000) % 2**32
