"""The other half of safety: while all is well the station keeps flying (A1)."""

from __future__ import annotations

from dataclasses import dataclass

from sitl_mocks.monitor.limits import MonitorLimits


@dataclass(slots=True)
class Availability:
    """Gaps between setpoints the vehicle would obey, always measured; judged only while `healthy`."""

    limits: MonitorLimits
    healthy: bool = False
    max_gap_s: float = 0.0
    max_gap_t_s: float | None = None
    _from_s: float | None = None
    _still_from_s: float | None = None
    _gap_counted: bool = False
    _hold_counted: bool = False

    def idle(self) -> None:
        """The vehicle does not obey: nothing is owed to it."""
        self._from_s = self._still_from_s = None

    def watch(self, now_s: float) -> str | None:
        """Time passes; the words of a failure, once for each gap, or None."""
        if self._from_s is None:
            return None
        gap_s = now_s - self._from_s
        if gap_s > self.max_gap_s:
            self.max_gap_s, self.max_gap_t_s = gap_s, now_s
        if not self.healthy or self._gap_counted or gap_s <= self.limits.gap_max_s + 1e-6:
            return None
        self._gap_counted = True
        return f"no setpoint for {gap_s:.3f} s"

    def setpoint(self, now_s: float, *, still: bool) -> str | None:
        """A setpoint that is obeyed; the words of a failure, once for each hold, or None."""
        failure = self.watch(now_s)
        self._from_s, self._gap_counted = now_s, False
        if not still:
            self._still_from_s, self._hold_counted = None, False
        elif self._still_from_s is None:
            self._still_from_s = now_s
        if failure is not None or self._still_from_s is None or not self.healthy or self._hold_counted:
            return failure
        run_s = now_s - self._still_from_s
        if run_s <= self.limits.zero_run_max_s:
            return None
        self._hold_counted = True
        return f"zero setpoints for {run_s:.2f} s"
