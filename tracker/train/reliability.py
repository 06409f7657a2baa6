"""What a confidence is worth: fit P(IoU > 0.5) to observed tracks, and measure how far it can be believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tracker.confidence import ConfidenceModel

BINS = 15
GOOD_IOU = 0.5
FOLDS = 10
RIDGE = 1e-4  # a penalty for each observation: separable data must not make the model sure without end
NEWTON_STEPS, ENOUGH = 50, 1e-9


class ReliabilityError(ValueError):
    """Observations that no reliability can be fitted to; one line with the figures."""


@dataclass(frozen=True, slots=True)
class Bin:
    """Observations whose confidence fell into one fifteenth: how many, their mean confidence, the share right."""

    count: int
    confidence: float
    good_frac: float


@dataclass(frozen=True, slots=True)
class Reliability:
    """A fitted model, and how it did on groups that it was not fitted to.

    ece: expected calibration error (15 bins of equal width). curve: the bins that hold anything. good_frac: share
    of observations that were right. auc: chance that a right one gets more confidence than a wrong one.
    """

    model: ConfidenceModel
    ece: float
    curve: tuple[Bin, ...]
    observations: int
    groups: int
    good_frac: float
    auc: float

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values for a weights manifest: the model's own and what it is worth."""
        return self.model.to_dict() | {
            "ece": self.ece,
            "auc": self.auc,
            "observations": self.observations,
            "groups": self.groups,
            "good_frac": self.good_frac,
            "curve": [[b.count, b.confidence, b.good_frac] for b in self.curve],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Reliability:
        """From to_dict's values. Raises ReliabilityError, or ConfidenceError for the model's own."""
        model = ConfidenceModel.from_dict(values)
        try:
            curve = tuple(Bin(int(n), float(c), float(g)) for n, c, g in values["curve"])
            shares = {k: float(values[k]) for k in ("ece", "good_frac", "auc")}
            return cls(
                model, curve=curve, observations=int(values["observations"]), groups=int(values["groups"]), **shares
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ReliabilityError(f"reliability is incomplete or malformed: {error!r}") from error


def fit(features: np.ndarray, good: np.ndarray, groups: np.ndarray, names: Sequence[str] | None = None) -> Reliability:
    """Fit by logistic regression; judge by leaving groups out, ten folds at most.

    features (N,K) float; good (N,) bool: IoU > 0.5; groups (N,): the clip each frame comes from, for frames of one
    clip are alike. Rows with a value that is not finite are left out: the model answers 0 to them by itself.
    Raises ReliabilityError where shapes differ, or with fewer than two groups, or where all or none are good.
    """
    features, good, groups = _checked(features, good, groups)
    names = tuple(names) if names is not None else tuple(f"feature_{i}" for i in range(features.shape[1]))
    model = _model(features, good, names)
    held_out = cross_validated(features, good, groups)
    curve = reliability_curve(held_out, good)
    return Reliability(
        model,
        expected_calibration_error(held_out, good),
        curve,
        len(good),
        len(np.unique(groups)),
        float(good.mean()),
        ranking_auc(held_out, good),
    )


def _checked(features: np.ndarray, good: np.ndarray, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    features, good, groups = np.asarray(features, float), np.asarray(good, bool), np.asarray(groups)
    if features.ndim != 2 or not features.shape[1] or good.shape != groups.shape or good.shape != features.shape[:1]:
        raise ReliabilityError(
            f"features {features.shape}, good {good.shape}, groups {groups.shape}: do not fit together"
        )
    kept = np.isfinite(features).all(1)
    features, good, groups = features[kept], good[kept], groups[kept]
    if not good.any() or good.all():
        raise ReliabilityError(f"{int(good.sum())} of {len(good)} observations are good: some of either are needed")
    if len(np.unique(groups)) < 2:
        raise ReliabilityError("observations of one clip only: two are needed to judge by one what the other taught")
    return features, good, groups


def _model(features: np.ndarray, good: np.ndarray, names: tuple[str, ...]) -> ConfidenceModel:
    mean, spread = features.mean(0), features.std(0)
    scale = np.where(spread > 1e-9 * np.maximum(1, np.abs(mean)), spread, 1.0)  # one that never changes says nothing
    weights = logistic((features - mean) / scale, good)
    as_floats = [tuple(float(v) for v in row) for row in (weights[:-1], mean, scale)]
    return ConfidenceModel(names, as_floats[0], float(weights[-1]), as_floats[1], as_floats[2])


def logistic(x: np.ndarray, good: np.ndarray, ridge: float = RIDGE) -> np.ndarray:
    """Weights (K,) and bias, together (K+1,), of the ridge logistic regression of x (N,K), by Newton's method.

    The penalty is N * ridge / 2 * |w|^2, without the bias. Damped: a step that does not descend is halved.
    """
    x1 = np.hstack([x, np.ones((len(x), 1))])
    strength = np.full(x1.shape[1], ridge * len(x))
    strength[-1] = 0.0
    w = np.zeros(x1.shape[1])

    def loss(at: np.ndarray) -> float:
        z = x1 @ at
        return float(np.logaddexp(0, np.where(good, -z, z)).sum() + 0.5 * strength @ at**2)

    now = loss(w)
    for _ in range(NEWTON_STEPS):
        p = _sigmoid(x1 @ w)
        slope = x1.T @ (p - good) + strength * w
        curvature = (x1 * (p * (1 - p))[:, None]).T @ x1 + np.diag(strength + 1e-9)
        step = np.linalg.solve(curvature, slope)
        size = 1.0
        while size > 1e-6 and loss(w - size * step) > now:
            size /= 2
        w = w - size * step
        before, now = now, loss(w)
        if before - now <= ENOUGH * max(1.0, abs(before)):
            break
    return w


def _sigmoid(z: np.ndarray) -> np.ndarray:
    return np.exp(-np.logaddexp(0, -z))


def cross_validated(features: np.ndarray, good: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Confidence (N,) of every observation by a model that saw none of its group."""
    names, index = np.unique(groups, return_inverse=True)
    fold = index % min(FOLDS, len(names))
    out = np.full(len(good), np.nan)
    for k in range(fold.max() + 1):
        left_out = fold == k
        taught = good[~left_out]
        if not taught.any() or taught.all():  # what it learned from was all alike: that is all it can say
            out[left_out] = taught.mean()
            continue
        model = _model(features[~left_out], taught, tuple(map(str, range(features.shape[1]))))
        out[left_out] = [model.probability(row) for row in features[left_out]]
    return out


def reliability_curve(confidence: np.ndarray, good: np.ndarray, bins: int = BINS) -> tuple[Bin, ...]:
    """Bins of equal width over 0..1 that hold anything, from low to high confidence."""
    index = np.minimum((confidence * bins).astype(int), bins - 1)
    found = []
    for i in range(bins):
        inside = index == i
        if inside.any():
            found.append(Bin(int(inside.sum()), float(confidence[inside].mean()), float(good[inside].mean())))
    return tuple(found)


def expected_calibration_error(confidence: np.ndarray, good: np.ndarray, bins: int = BINS) -> float:
    """Mean over observations of |share right - mean confidence| of their bin (Guo et al. 2017, eq. 3)."""
    curve = reliability_curve(confidence, good, bins)
    return sum(b.count * abs(b.good_frac - b.confidence) for b in curve) / len(good)


def ranking_auc(confidence: np.ndarray, good: np.ndarray) -> float:
    """Chance that a right observation has more confidence than a wrong one; ties count half."""
    _, inverse, counts = np.unique(confidence, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    right, wrong = int(good.sum()), int((~good).sum())
    return float((ranks[good].sum() - right * (right + 1) / 2) / (right * wrong))


def draw(reliability: Reliability, path: Path) -> Path:
    """The reliability curve over how often each confidence occurs, as PNG."""
    figure = Figure(figsize=(5, 5.5), layout="constrained")
    curve, often = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    curve.plot([0, 1], [0, 1], color="0.6", ls="--", lw=1, label="as good as its word")
    x, y = ([getattr(b, name) for b in reliability.curve] for name in ("confidence", "good_frac"))
    curve.plot(x, y, "o-", color="C0", label="held-out clips")
    curve.set(xlim=(0, 1), ylim=(0, 1), ylabel=f"share with IoU > {GOOD_IOU:g}")
    curve.set_title(
        f"expected calibration error {reliability.ece:.3f}, ranking AUC {reliability.auc:.3f}\n"
        f"{reliability.observations} frames of {reliability.groups} clips, left out in turn",
        fontsize=10,
    )
    curve.legend(loc="upper left", frameon=False)
    often.bar(x, [b.count for b in reliability.curve], width=0.8 / BINS, color="C0")
    often.set(xlabel="confidence", ylabel="frames")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path
