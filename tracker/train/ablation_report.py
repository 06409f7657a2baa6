"""What the ablations came to: tables with mean and standard deviation over seeds, and a chart."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tracker.configs import Variant
from tracker.eval.ope import Score
from tracker.train.ablation_config import AblationConfig, EvaluationLatent, grader_of

TITLES = {
    Variant.HIFT: "Baseline (HiFT)",
    Variant.LCT: "LCT",
    Variant.GSTC_LCT: "GSTC + LCT",
    Variant.MS_FUSION_LCT: "MS fusion + LCT",
    Variant.CLIMNET_HIFT: "ClimNet + HiFT",
    Variant.FULL: "ClimNet + LCT (ClimRT)",
}
# Success AUC and precision at 20 px on UAVTrack112, as the paper prints them.
PAPER = {
    Variant.HIFT: (0.570, 0.742),
    Variant.LCT: (0.573, 0.747),
    Variant.GSTC_LCT: (0.575, 0.754),
    Variant.MS_FUSION_LCT: (0.581, 0.759),
    Variant.CLIMNET_HIFT: (0.577, 0.750),
    Variant.FULL: (0.588, 0.770),
}
PREVIOUS_NOTE = (
    "The previous patch stood in for the latent frame: no ClimNet was run, so the variants that differ only in "
    "ClimNet's blocks (GSTC + LCT, MS fusion + LCT, ClimNet + LCT) are one and the same here, trained and scored once."
)


@dataclass(frozen=True, slots=True)
class Cell:
    """One variant, seed and interval: mean score over the sequences; held_out: figures on composed samples."""

    variant: Variant
    seed: int
    interval: int
    drawn: bool  # the latent frame was ClimNet's
    score: Score
    held_out: dict[str, float]


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and sample standard deviation over seeds; of one seed the latter is not a number."""

    mean: float
    std: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of one figure's values."""
        std = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
        return cls(float(np.mean(values)), std, len(values))

    def __str__(self) -> str:
        return f"{self.mean:.3f} ± {self.std:.3f}" if self.count > 1 else f"{self.mean:.3f}"


@dataclass(frozen=True, slots=True)
class Row:
    """One variant and interval over all seeds. latent: where its latent frame came from."""

    variant: Variant
    interval: int
    latent: str
    auc: Spread
    precision: Spread
    mean_iou: Spread


def rows_of(cells: Sequence[Cell]) -> list[Row]:
    """A row per variant and interval, in the order they come."""
    groups: dict[tuple[Variant, int], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.variant, cell.interval), []).append(cell)
    return [
        Row(
            variant,
            interval,
            ("ClimNet" if some[0].drawn else "previous patch") if variant.uses_latent else "none",
            Spread.of([c.score.auc for c in some]),
            Spread.of([c.score.precision for c in some]),
            Spread.of([c.held_out.get("mean_iou", float("nan")) for c in some]),
        )
        for (variant, interval), some in groups.items()
    ]


def write_report(
    folder: Path,
    config: AblationConfig,
    cells: Sequence[Cell],
    latents: Mapping[str, Mapping[str, float]],
    sequences: Sequence[tuple[str, int]],
) -> Path:
    """table.md (returned), table.json and chart.png in the folder.

    latents: figures of each ClimNet trained here. sequences: names and numbers of frames.
    """
    rows = rows_of(cells)
    values = {
        "config": config.to_dict(),
        "sequences": dict(sequences),
        "rows": [_plain(row) for row in rows],
        "latents": {name: dict(figures) for name, figures in latents.items()},
        "note": honest_note(config, rows),
    }
    (folder / "table.json").write_text(json.dumps(values, indent=1) + "\n")
    _draw(rows, folder / "chart.png")
    path = folder / "table.md"
    path.write_text("\n".join(_markdown(config, rows, latents, sequences)) + "\n")
    return path


def honest_note(config: AblationConfig, rows: Sequence[Row]) -> str:
    """What a budget of this size can show, from the figures themselves."""
    first = [row for row in rows if row.interval == 1]
    best, worst = max(r.auc.mean for r in first), min(r.auc.mean for r in first)
    budget = (
        f"Every variant learned from {config.samples} composed samples per seed on a frozen, already trained backbone; "
        "the paper's from tens of millions. "
    )
    if len(config.seeds) < 2:
        return budget + "With one seed nothing can be said of chance: no difference in this table is a finding."
    noise = float(np.sqrt(np.mean([r.auc.std**2 for r in first])))
    limit = 2 * noise * np.sqrt(2 / len(config.seeds))
    verdict = "is within it: the order of the variants is not a finding" if best - worst < limit else "exceeds it"
    return budget + (
        f"Seeds alone move AUC by {noise:.3f} (standard deviation), so that two variants' means over "
        f"{len(config.seeds)} seeds must lie {limit:.3f} apart to differ beyond chance; the widest gap here, "
        f"{best - worst:.3f}, {verdict}. This shows which variants learn quickly, not which is best once trained."
    )


def _markdown(
    config: AblationConfig,
    rows: Sequence[Row],
    latents: Mapping[str, Mapping[str, float]],
    sequences: Sequence[tuple[str, int]],
) -> list[str]:
    frames = sum(count for _, count in sequences)
    seeds = ", ".join(map(str, config.seeds))
    lines = [
        "# Ablations",
        "",
        f"{config.samples} samples per variant, seeds {seeds}, backbone of `{config.start_from}` frozen; "
        f"{len(sequences)} sequences, {frames} frames. Mean ± standard deviation over seeds.",
        "",
        honest_note(config, rows),
        "",
        "| variant | latent frame | AUC | precision | held-out IoU | paper (UAVTrack112) |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in (r for r in rows if r.interval == 1):
        paper = "{:.3f} / {:.3f}".format(*PAPER[row.variant])
        cells = (TITLES[row.variant], row.latent, row.auc, row.precision, row.mean_iou, paper)
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    if config.latent is EvaluationLatent.PREVIOUS and _has_twins(config):
        lines += ["", PREVIOUS_NOTE]
    if len(config.intervals) > 1:
        lines += ["", "| variant | m | latent frame | AUC | precision |", "| --- | --- | --- | --- | --- |"]
        for row in (r for r in rows if r.variant in config.interval_variants):
            cells = (TITLES[row.variant], row.interval, row.latent, row.auc, row.precision)
            lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines + _latent_lines(config, latents)


def _latent_lines(config: AblationConfig, latents: Mapping[str, Mapping[str, float]]) -> list[str]:
    given = [f"ClimNet of {v.value}: `{file}`, not trained here." for v, file in config.climnet_weights.items()]
    lines = ["", *given] if given else []
    shown = {name: figures for name, figures in latents.items() if "psnr_db" in figures}
    if not shown:
        return lines
    head = "| ClimNet of | PSNR | copy of the previous frame | mean of both | gain |"
    lines += ["", f"Latent frames after {config.climnet_samples} samples, held-out clips, dB:", ""]
    lines += [head, "| --- | --- | --- | --- | --- |"]
    for name, f in shown.items():
        figures = " | ".join(f"{f[key]:.2f}" for key in ("psnr_db", "psnr_copy_db", "psnr_mean_db", "psnr_gain_db"))
        lines.append(f"| {name} | {figures} |")
    return lines


def _has_twins(config: AblationConfig) -> bool:
    graders = [grader_of(v) for v in config.variants]
    return len(set(graders)) < len(graders)


def _plain(row: Row) -> dict[str, Any]:
    spreads = {name: asdict(getattr(row, name)) for name in ("auc", "precision", "mean_iou")}
    for spread in spreads.values():
        spread.update({k: None for k, v in spread.items() if v != v})  # JSON knows no NaN
    paper = dict(zip(("auc", "precision"), PAPER[row.variant], strict=True))
    named = {"variant": row.variant.value, "interval": row.interval, "latent": row.latent}
    return named | {"paper_uavtrack112": paper} | spreads


def _draw(rows: Sequence[Row], path: Path) -> None:
    """Bars of AUC and precision with error bars: variants, and intervals where there are several."""
    first = [r for r in rows if r.interval == 1]
    several = {r.variant for r in rows if r.interval > 1}
    figure = Figure(figsize=(11 if several else 8, 4.2), layout="constrained")
    axes = figure.subplots(1, 2 if several else 1, squeeze=False)[0]
    _bars(axes[0], first, [TITLES[r.variant].replace(" + ", " +\n").replace(" (", "\n(") for r in first])
    if several:
        others = [r for r in rows if r.variant in several]
        _bars(axes[1], others, [f"{r.variant.value}\nm = {r.interval}" for r in others])
    axes[0].set_title("variants")
    axes[0].set_ylabel("mean over sequences, ± standard deviation over seeds")
    figure.savefig(path, dpi=110)


def _bars(axis: Any, rows: Sequence[Row], labels: Sequence[str]) -> None:
    at = np.arange(len(rows))
    for offset, name, colour in ((-0.2, "auc", "#3b6ea5"), (0.2, "precision", "#d98e32")):
        spreads = [getattr(row, name) for row in rows]
        errors = np.nan_to_num([s.std for s in spreads])
        axis.bar(at + offset, [s.mean for s in spreads], 0.38, yerr=errors, capsize=3, color=colour, label=name)
    axis.set_xticks(at, labels, fontsize=7)
    axis.set_ylim(0, 1)
    axis.grid(axis="y", alpha=0.3)
    axis.legend(fontsize=8)
