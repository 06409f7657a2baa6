"""From the box in a frame to the filtered line of sight: camera, attitude at capture time, estimator. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from control.attitude import Angles, AttitudeBuffer, wrap_pi
from control.camera import CameraModel, bearing_measurement
from control.camera_check import CameraCheck, Verdict
from control.config import EstimatorConfig
from control.estimator import TargetEstimator
from control.types import BearingMeasurement
from gcs.flight_vision import Seen

# Older than they are taken for, by so much: as long as the glass delay is not known, pictures of a rightly mounted
# camera seem to turn late. Only what turns wrongly at all of them is wrong.
_OLDER_S: Final = (0.0, 0.1, 0.2)


class Sight:
    """Give it every frame the tracker has been through; ask `estimator` for the target at any time."""

    def __init__(
        self,
        config: EstimatorConfig,
        camera: CameraModel,
        attitude: AttitudeBuffer,
        *,
        kept_centred: bool = False,
        delay_given: bool = True,
    ) -> None:
        """attitude: what the camera's mount is fixed to, vehicle or gimbal. kept_centred: see `CameraCheck`.

        delay_given: False where capture times may be wrong by what is still being learned of the glass delay.
        """
        self.camera = camera
        self.attitude = attitude
        self.estimator = TargetEstimator(config)
        older_s = _OLDER_S if not delay_given else _OLDER_S[:1]
        self._checks = tuple((each_s, CameraCheck(kept_centred=kept_centred)) for each_s in older_s)

    def reset(self) -> None:
        """Another target, or none: what was known of it is forgotten."""
        self.estimator.reset()
        for _, check in self._checks:
            check.reset()

    @property
    def camera_is_wrong(self) -> bool:
        """The picture does not move as the vehicle turns: mirrored, upside down or mounted otherwise."""
        return all(check.verdict is Verdict.WRONG for _, check in self._checks)

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
            self._check(measurement, attitude)
        return measurement, accepted

    def _check(self, measurement: BearingMeasurement, attitude: Angles) -> None:
        for older_s, check in self._checks:
            turned = self.attitude.at(measurement.t_capture_s - older_s)
            if turned is not None:
                azimuth_rad = wrap_pi(measurement.azimuth_rad - attitude[2] + turned[2])
                check.saw(replace(measurement, azimuth_rad=azimuth_rad), turned[2])
