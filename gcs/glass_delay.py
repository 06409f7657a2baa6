"""How old a picture is when it arrives: what the owner has measured, or what the flight itself shows."""

from __future__ import annotations

from typing import Final

from control.attitude import AttitudeBuffer
from control.camera import CameraModel
from control.image_rotation import Flow
from control.latency import PRIOR_S, DelayEstimate, GlassDelayEstimator

_SLEW: Final = 0.05  # s per second: the target filter must not be torn
_DIFFERENCE_S: Final = 0.06
_LASTING_S: Final = 3.0


class GlassDelay:
    """Give it the background's flow of every picture. given_s: None means to be estimated, from PRIOR_S on.

    used_s: what is believed now. The video source takes off what it begins with; what is left is `correction_s`,
    which any thread may ask for.
    """

    def __init__(self, given_s: float | None, camera: CameraModel, attitude: AttitudeBuffer) -> None:
        self._given_s = given_s
        self._estimator = GlassDelayEstimator(camera, attitude)
        self._assumed_s = self.used_s = PRIOR_S if given_s is None else given_s
        self._differs_since_s: float | None = None
        self._t_s = 0.0

    @property
    def is_given(self) -> bool:
        """Not to be estimated."""
        return self._given_s is not None

    @property
    def estimate(self) -> DelayEstimate:
        """What the pictures tell."""
        return self._estimator.estimate

    def correction_s(self) -> float:
        """To be taken off the capture times that the video source gives."""
        return self.used_s - self._assumed_s

    def saw(self, flow: Flow) -> None:
        """How the background has moved up to a picture."""
        self._estimator.add(flow)
        self._t_s = flow.to_t_s
        estimate = self.estimate
        error_s = estimate.delay_s - self.used_s
        if self._given_s is not None:
            differs = estimate.known and abs(error_s) > _DIFFERENCE_S
            since_s = self._t_s if self._differs_since_s is None else self._differs_since_s
            self._differs_since_s = since_s if differs else None
        elif estimate.known:
            most_s = _SLEW * (flow.to_t_s - flow.from_t_s)
            self.used_s += min(max(error_s, -most_s), most_s)

    def warnings(self) -> tuple[str, ...]:
        """Where the delay is not known yet, or the given one is not what is seen."""
        if not self.is_given and not self.estimate.known:
            return (f"the video's delay is not known yet, {self.used_s * 1000:.0f} ms assumed; turning tells it",)
        since_s = self._differs_since_s
        if since_s is None or self._t_s - since_s < _LASTING_S:
            return ()
        seen_ms, given_ms = self.estimate.delay_s * 1000, self.used_s * 1000
        return (f"pictures are {seen_ms:.0f} ms old when they arrive, not {given_ms:.0f} as camera.glass_delay_s says",)
