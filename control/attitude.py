"""The vehicle's attitude at the moment a picture was taken: a ring buffer of telemetry, interpolated."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

Angles = tuple[float, float, float]
_RATE_SPAN_S = 0.03


def wrap_pi(angle_rad: float) -> float:
    """The same direction within -pi (exclusive) to pi (inclusive)."""
    wrapped = math.remainder(angle_rad, 2 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


class AttitudeBuffer:
    """Roll, pitch, yaw (rad, FRD body against NED) over time, newest `capacity` samples.

    Interpolates each angle the short way round. Beyond the newest sample it extrapolates for at most
    max_ahead_s at the newest samples' rate; inside a gap longer than max_gap_s it knows nothing.
    """

    def __init__(self, capacity: int = 512, max_ahead_s: float = 0.1, max_gap_s: float = 0.5) -> None:
        if capacity < 2:
            raise ValueError(f"capacity must be at least 2, not {capacity}")
        self._capacity, self._max_ahead_s, self._max_gap_s = capacity, max_ahead_s, max_gap_s
        self._times_s: list[float] = []
        self._angles: list[Angles] = []

    def add(self, t_s: float, roll_rad: float, pitch_rad: float, yaw_rad: float) -> bool:
        """Store a sample, in any order of time; False (and nothing stored) for NaN, inf or a time known."""
        if not all(map(math.isfinite, (t_s, roll_rad, pitch_rad, yaw_rad))):
            return False
        at = bisect_left(self._times_s, t_s)
        if at < len(self._times_s) and self._times_s[at] == t_s:
            return False
        self._times_s.insert(at, t_s)
        self._angles.insert(at, (roll_rad, pitch_rad, yaw_rad))
        if len(self._times_s) > self._capacity:
            del self._times_s[0], self._angles[0]
        return True

    def at(self, t_s: float) -> Angles | None:
        """(roll, pitch, yaw) in rad at t_s, or None where the buffer does not reach."""
        times = self._times_s
        if not times or not math.isfinite(t_s) or t_s < times[0] or t_s - times[-1] > self._max_ahead_s:
            return None
        if t_s >= times[-1]:
            return self._ahead(t_s)
        right = bisect_right(times, t_s)
        start_s, end_s = times[right - 1], times[right]
        if t_s == start_s:
            return self._angles[right - 1]
        if end_s - start_s > self._max_gap_s:
            return None
        return _blend(self._angles[right - 1], self._angles[right], (t_s - start_s) / (end_s - start_s))

    def _ahead(self, t_s: float) -> Angles:
        """The newest sample carried on at its rate; over a shorter span the rate would be mostly jitter."""
        newest_s = self._times_s[-1]
        left = bisect_right(self._times_s, newest_s - _RATE_SPAN_S) - 1
        if left < 0 or newest_s - self._times_s[left] > self._max_gap_s:
            return self._angles[-1]
        span_s = newest_s - self._times_s[left]
        return _blend(self._angles[left], self._angles[-1], 1 + (t_s - newest_s) / span_s)

    def rate_hz(self, now_s: float, window_s: float = 2.0) -> float:
        """Samples per second within the last window_s."""
        return (bisect_right(self._times_s, now_s) - bisect_left(self._times_s, now_s - window_s)) / window_s

    @property
    def newest_t_s(self) -> float | None:
        """Time of the newest sample, None if there is none."""
        return self._times_s[-1] if self._times_s else None


def _blend(a: Angles, b: Angles, frac: float) -> Angles:
    roll, pitch, yaw = (wrap_pi(x + frac * wrap_pi(y - x)) for x, y in zip(a, b, strict=True))
    return roll, pitch, yaw
