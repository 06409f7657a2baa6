"""What went over the link, and what the vehicle's parameters were judged to be."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from gcs.audit import Audit, Level
from gcs.link_meters import LinkFigures
from gcs.report.figures import Audited, Link, Parameter
from gcs.report.sampling import Curve

_GAP_S: Final = 3.0  # the figures come once a second
_BEGINS_S: Final = 2.0  # what came while the station was starting was lost here, not on the link


@dataclass(slots=True)
class LinkTally:
    """Times: seconds since start_s."""

    start_s: float
    loss: Curve = field(default_factory=lambda: Curve(_GAP_S))  # percent
    received_kbps: Curve = field(default_factory=lambda: Curve(_GAP_S))  # kB/s
    sent_kbps: Curve = field(default_factory=lambda: Curve(_GAP_S))
    setpoints_hz: Curve = field(default_factory=lambda: Curve(_GAP_S))
    link: Link | None = None
    audit: Audited | None = None
    _most_loss_frac: float = 0.0
    _from_s: float | None = None
    _before: tuple[float, int] | None = None  # time, setpoints sent until then

    def figures(self, figures: LinkFigures, at_s: float) -> None:
        """The link in numbers, about once a second."""
        totals = figures.totals
        self.loss.add(at_s, figures.loss_frac * 100)
        self.received_kbps.add(at_s, figures.received_bytes_per_s / 1000)
        self.sent_kbps.add(at_s, figures.sent_bytes_per_s / 1000)
        if self._before is not None and at_s > self._before[0]:
            self.setpoints_hz.add(at_s, (totals.setpoints_sent - self._before[1]) / (at_s - self._before[0]))
        self._before = (at_s, totals.setpoints_sent)
        self._from_s = at_s + _BEGINS_S if self._from_s is None else self._from_s
        if at_s >= self._from_s:
            self._most_loss_frac = max(self._most_loss_frac, figures.loss_frac)
        over_s = max(at_s, 1.0)
        self.link = Link(
            received_kbps=totals.bytes_received / over_s / 1000,
            sent_kbps=totals.bytes_sent / over_s / 1000,
            most_loss_frac=self._most_loss_frac,
            bad_frames=figures.bad_frames,
            setpoints_sent=totals.setpoints_sent,
            dropped_late=totals.stale,
        )

    def audited(self, audit: Audit) -> None:
        """The newest judgement takes the place of the one before."""
        levels = Counter(finding.level for finding in audit.findings)
        said = tuple(
            f"{finding} ({'accepted' if finding.accepted else finding.level.value})"
            for finding in audit.findings
            if finding.level is not Level.FINE
        )
        parameters = tuple(
            Parameter(found.name, found.value, found.wanted, found.level.value, found.why, found.accepted)
            for found in audit.findings
        )
        self.audit = Audited(
            audit.autopilot, levels[Level.FINE], levels[Level.ADVICE], levels[Level.UNSAFE], said, parameters
        )
