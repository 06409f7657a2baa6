"""From the box in a frame to the filtered line of sight: camera, attitude at capture time, estimator. Pure."""

from __future__ import annotations

from control.attitude import AttitudeBuffer
from control.camera import CameraModel, bearing_measurement
from control.camera_check import CameraCheck, Verdict
from control.config import EstimatorConfig
from control.estimator import TargetEstimator
from control.types import BearingMeasurement
from gcs.flight_vision import Seen


class Sight:
    """Give it every frame the tracker has been through; ask `estimator` for the target at any time."""

    def __init__(
        self, config: EstimatorConfig, camera: CameraModel, attitude: AttitudeBuffer, *, kept_centred: bool = False
    ) -> None:
        """attitude: what the camera's mount is fixed to, vehicle or gimbal. kept_centred: see `CameraCheck`."""
        self.camera = camera
        self.attitude = attitude
        self.estimator = TargetEstimator(config)
        self._camera_check = CameraCheck(kept_centred=kept_centred)

    def reset(self) -> None:
        """Another target, or none: what was known of it is forgotten."""
        self.estimator.reset()
        self._camera_check.reset()

    @property
    def camera_is_wrong(self) -> bool:
        """The picture does not move as the vehicle turns: mirrored, upside down or mounted otherwise."""
        return self._camera_check.verdict is Verdict.WRONG

    def saw(self, seen: Seen) -> tuple[BearingMeasurement, bool] | None:
        """The line of sight of the box, and whether the filter took it; None where there is none."""
        result, t_capture_s = seen.result, seen.frame.t_capture_s
        if result is None or not result.visible:
            return None
        attitude = self.attitude.at(t_capture_s)
        if attitude is None:
            return None
        box = result.box
        try:
            measurement = bearing_measurement(
                self.camera, box.cx_px, box.cy_px, box.w_px, box.h_px, attitude, t_capture_s, result.confidence
            )
        except ValueError:  # a box no ray can be made of
            return None
        accepted = self.estimator.update(measurement)
        if accepted:
            self._camera_check.saw(measurement, attitude[2])
        return measurement, accepted
