"""From features of one frame's answer to the probability that its box is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


class ConfidenceError(ValueError):
    """A confidence model, or what it is asked about, does not fit; one line with the figures."""


@dataclass(frozen=True, slots=True)
class ConfidenceModel:
    """P(IoU > 0.5) by logistic regression on a few features, as weights' manifests carry it.

    names: of the K features, in the order in which they are given. mean, scale: what is taken off each feature
    and what it is divided by; weights: of the results; bias: added to their sum. Fitted by
    tracker.train.reliability on clips that nothing was trained on.
    """

    names: tuple[str, ...]
    weights: tuple[float, ...]
    bias: float
    mean: tuple[float, ...]
    scale: tuple[float, ...]

    def __post_init__(self) -> None:
        count = len(self.names)
        if not count or {len(self.weights), len(self.mean), len(self.scale)} != {count}:
            lengths = f"{len(self.weights)} weights, {len(self.mean)} means, {len(self.scale)} scales"
            raise ConfidenceError(f"confidence model of {count} features has {lengths}")
        if not all(map(math.isfinite, (*self.weights, self.bias, *self.mean, *self.scale))):
            raise ConfidenceError("confidence model: all values must be finite numbers")
        if min(self.scale) <= 0:
            raise ConfidenceError(f"confidence model: scale {min(self.scale)} must be over 0")

    def probability(self, features: Sequence[float]) -> float:
        """P(IoU > 0.5), 0..1, of the features in the order of `names`; 0 where one is not a finite number.

        Raises ConfidenceError for another number of features.
        """
        values = np.asarray(features, float)
        if values.shape != (len(self.names),):
            raise ConfidenceError(f"{values.size} features where {len(self.names)} are wanted: {', '.join(self.names)}")
        if not np.isfinite(values).all():
            return 0.0
        z = float(np.dot((values - self.mean) / self.scale, self.weights)) + self.bias
        return logistic(z)

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        return {
            "names": list(self.names),
            "weights": list(self.weights),
            "bias": self.bias,
            "mean": list(self.mean),
            "scale": list(self.scale),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ConfidenceModel:
        """From to_dict's values, others beside them ignored. Raises ConfidenceError."""
        try:
            numbers = {k: tuple(float(v) for v in values[k]) for k in ("weights", "mean", "scale")}
            return cls(tuple(map(str, values["names"])), bias=float(values["bias"]), **numbers)
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, ConfidenceError):
                raise
            raise ConfidenceError(f"confidence model is incomplete or malformed: {error!r}") from error


def logistic(log_odds: float) -> float:
    """Probability, 0..1, of log odds; never overflows."""
    return 1 / (1 + math.exp(-log_odds)) if log_odds > 0 else math.exp(log_odds) / (1 + math.exp(log_odds))
