"""Where the time goes from light to command, picture by picture, in memory that does not grow."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, fields
from typing import Final

from gcs.latency_budget import Budget
from gcs.report.figures import Percentiles
from gcs.report.sampling import Curve, Spread

PARTS: Final = tuple(part.name.removesuffix("_s") for part in fields(Budget))  # in the order they pass
TOTAL: Final = "total"
BIN_MS: Final = 2
_ROUNDING_MS: Final = 1e-6
_MOST_S: Final = 3600.0


@dataclass(slots=True)
class Bin:
    """Pictures whose total lies between two edges: how many, and the sum of each part in s."""

    count: int = 0
    sums_s: list[float] = field(default_factory=lambda: [0.0] * len(PARTS))


@dataclass(slots=True)
class LatencyTally:
    """bins: by the total in steps of BIN_MS."""

    total_ms: Curve = field(default_factory=Curve)
    spreads: dict[str, Spread] = field(default_factory=dict)
    bins: defaultdict[int, Bin] = field(default_factory=lambda: defaultdict(Bin))

    def add(self, budget: Budget, at_s: float) -> None:
        """One picture's; what cannot be is left out."""
        values_s = [getattr(budget, f"{name}_s") for name in PARTS]
        if not all(abs(value_s) <= _MOST_S for value_s in values_s):
            return
        for name, value_s in zip((*PARTS, TOTAL), (*values_s, budget.total_s), strict=True):
            self.spreads.setdefault(name, Spread()).add(value_s)
        self.total_ms.add(at_s, budget.total_s * 1000)
        found = self.bins[int((budget.total_s * 1000 + _ROUNDING_MS) // BIN_MS)]
        found.count += 1
        found.sums_s = [total + value for total, value in zip(found.sums_s, values_s, strict=True)]

    def percentiles(self) -> dict[str, Percentiles]:
        """By part, and in total."""
        return {
            name: Percentiles(*(spread.percentile_ms(share) for share in (0.5, 0.95, 0.99)))
            for name, spread in self.spreads.items()
        }
