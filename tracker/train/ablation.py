"""The paper's ablations with equal, small budgets: train each variant, score it on sequences, for several seeds.

Everything is kept as it is made (weights per variant and seed, scores per variant, seed and interval), so a run that
was broken off goes on where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from tracker.configs import LatentProvider, NetworkConfig, TrackerConfig, Variant
from tracker.eval import sequences as recorded
from tracker.eval.ope import Score, mean_score
from tracker.eval.run import run_sequence
from tracker.network.climnet import ClimNet
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker
from tracker.train.ablation_config import AblationConfig, EvaluationLatent, climnet_of, grader_of
from tracker.train.ablation_report import Cell, write_report
from tracker.train.ablation_training import CPU, shared_backbone, train_climnet, train_graders
from tracker.train.config import StageKind, TrainConfigError
from tracker.train.pack import Imagery, load
from tracker.train.validation import Examiner, sample_figures
from tracker.weights import load_network, load_parts, read_manifest, save, save_tensors

Say = Callable[[str], None]

# Probabilities and a steady size, and nothing besides that would hide what the network itself does.
PLAIN = TrackerConfig(cls2_is_logit=False, clip_rate=True, calibrate=True, size_rate=0.04)


@dataclass(frozen=True, slots=True)
class Entry:
    """What is scored once: a trained transformer, where its latent frame comes from, how far back that looks."""

    grader: Variant
    climnet: Variant | None
    seed: int
    interval: int

    @property
    def name(self) -> str:
        """Of its file of scores."""
        latent = f"climnet_{self.climnet.value}" if self.climnet else "previous"
        source = f"-{latent}" if self.grader.uses_latent else ""
        return f"{self.grader.value}{source}-m{self.interval}-seed{self.seed}"


def entry_of(config: AblationConfig, variant: Variant, seed: int, interval: int = 1) -> Entry:
    """Variants that differ only in a ClimNet which is not run share an entry."""
    drawn = variant.uses_latent and config.latent is EvaluationLatent.CLIMNET
    return Entry(grader_of(variant), climnet_of(variant) if drawn else None, seed, interval)


def ablate(values: dict[str, Any], data: Path, dataset: Path, folder: Path, say: Say) -> Path:
    """Train and score everything that the folder lacks, then write table.md, table.json and chart.png there.

    values: tracker.train.ablation_config. data: folder with the packs; dataset: sequences with truth. Returns the
    table's path. Raises TrainConfigError, WeightsError, SequenceError, FileNotFoundError with one clear line.
    """
    config = AblationConfig.from_dict(values)
    torch.set_num_threads(config.threads)
    torch.set_flush_denormal(True)
    sequences = [_beginning(s, config.frames) for s in recorded.load_dataset(dataset)]
    run = AblationRun(config, folder, say)
    run.train([data / pack for pack in config.packs])
    run.score(sequences)
    return run.report(sequences)


class AblationRun:
    """One configuration in its folder: config.json, graders/, climnets/, scores/."""

    def __init__(self, config: AblationConfig, folder: Path, say: Say) -> None:
        self.config, self.folder, self._say = config, folder, say
        _claim(folder, config)
        self._widths, _ = shared_backbone(config.start_from)

    # -- training ----------------------------------------------------------------------------------------

    def train(self, packs: Sequence[Path]) -> None:
        """Train what has no weights yet; all graders that a seed lacks side by side."""
        config = self.config
        kinds = list(dict.fromkeys(map(grader_of, config.variants)))
        lacking = {seed: [k for k in kinds if not self._grader(k, seed).exists()] for seed in config.seeds}
        lacking = {seed: some for seed, some in lacking.items() if some}
        climnets = [(d, s) for s in config.seeds for d in self._designs() if not self._climnet(d, s).exists()]
        if not lacking and not climnets:
            return
        missing = next((pack for pack in packs if not pack.exists()), None)
        if missing is not None:
            raise TrainConfigError(f"{missing}: no such pack of training pictures")
        self._say("reading pictures")
        imagery, held_out = load(list(packs)), load(list(packs), split="val")
        for seed, some in lacking.items():
            self._train_graders(seed, some, imagery, held_out)
        for design, seed in climnets:
            self._train_climnet(seed, design, imagery, held_out)

    def _designs(self) -> list[Variant]:
        """The kinds of ClimNet to be trained here."""
        if not self.config.climnet_samples:
            return []
        used = dict.fromkeys(climnet_of(v) for v in self.config.variants if v.uses_latent)
        return [design for design in used if design not in self.config.climnet_weights]

    def _train_graders(self, seed: int, kinds: list[Variant], imagery: Imagery, held_out: Imagery) -> None:
        names = ", ".join(k.value for k in kinds)
        steps = self.config.samples // self.config.batch
        with tqdm(total=steps, desc=f"seed {seed}: {names}", unit="batch") as bar:
            networks = train_graders(self.config, seed, kinds, imagery, bar.update)
        examiner = Examiner(held_out, self.config.training(0))
        for kind, network in networks.items():
            with torch.no_grad():
                figures = sample_figures(network, examiner.samples, CPU)
            save(self._grader(kind, seed), network, {"seed": seed, "samples": self.config.samples, "held_out": figures})

    def _train_climnet(self, seed: int, design: Variant, imagery: Imagery, held_out: Imagery) -> None:
        steps = self.config.training(seed).stages[1].steps
        with tqdm(total=steps, desc=f"seed {seed}: ClimNet of {design.value}", unit="batch") as bar:
            network = train_climnet(self.config, seed, design, imagery, bar.update)
        figures = Examiner(held_out, self.config.training(0)).examine(network, StageKind.CLIMNET, CPU)
        extra = {"seed": seed, "samples": self.config.climnet_samples, "held_out": figures}
        save_tensors(
            self._climnet(design, seed), _internet(network.state_dict()), network.config, extra, parts=("internet",)
        )

    def _grader(self, kind: Variant, seed: int) -> Path:
        return self.folder / "graders" / f"{kind.value}-seed{seed}.safetensors"

    def _climnet(self, design: Variant, seed: int) -> Path:
        return self.folder / "climnets" / f"{design.value}-seed{seed}.safetensors"

    # -- scoring -----------------------------------------------------------------------------------------

    def entries(self) -> list[Entry]:
        """Everything to be scored, each once."""
        config = self.config
        found = [
            entry_of(config, variant, seed, m)
            for m in sorted(config.intervals)
            for variant in config.variants
            for seed in config.seeds
            if m == 1 or variant in config.interval_variants
        ]
        return list(dict.fromkeys(found))

    def score(self, sequences: Sequence[recorded.Sequence]) -> None:
        """Score what has no scores yet."""
        pending = [e for e in self.entries() if not self._scores(e).exists()]
        frames = sum(len(s.truth_xywh) for s in sequences)
        with tqdm(total=len(pending) * frames, desc="scoring", unit="frame", disable=not pending) as bar:
            for entry in pending:
                bar.set_description(entry.name)
                network, tracker = self.network(entry), self._tracker(entry)
                outcomes = {s.name: run_sequence(ClimRTTracker(network, tracker), s, bar.update) for s in sequences}
                _write_json(self._scores(entry), {name: asdict(o.score) for name, o in outcomes.items()})

    def network(self, entry: Entry) -> ClimRT:
        """The trained network of an entry. Raises WeightsError."""
        grader = load_network(self._grader(entry.grader, entry.seed))
        if entry.climnet is None:
            return grader
        # GSTC, MS fusion or all of ClimNet: its own configuration knows which.
        climnet, widths = self._trained_climnet(entry.climnet, entry.seed)
        grader.internet, grader.config = climnet, replace(grader.config, climnet=widths.climnet)
        return grader.eval()

    def _trained_climnet(self, design: Variant, seed: int) -> tuple[ClimNet, NetworkConfig]:
        path = Path(self.config.climnet_weights.get(design, self._climnet(design, seed)))
        config = read_manifest(path).network
        whole = ClimRT(config)
        if "internet" not in load_parts(path, whole) or climnet_of(config.variant) is not design:
            raise TrainConfigError(f"climnet_weights: {path} holds no ClimNet of {design.value}")
        return whole.internet, config

    def _tracker(self, entry: Entry) -> TrackerConfig:
        if not entry.grader.uses_latent:
            return replace(PLAIN, latent=LatentProvider.OFF)
        latent = LatentProvider.CLIMNET if entry.climnet else LatentProvider.PREVIOUS
        return replace(PLAIN, latent=latent, latent_interval=entry.interval)

    def _scores(self, entry: Entry) -> Path:
        return self.folder / "scores" / f"{entry.name}.json"

    # -- telling -----------------------------------------------------------------------------------------

    def report(self, sequences: Sequence[recorded.Sequence]) -> Path:
        """Tables and chart of everything scored."""
        config = self.config
        cells = [
            self._cell(variant, seed, m)
            for variant in config.variants
            for m in sorted(config.intervals)
            for seed in config.seeds
            if m == 1 or variant in config.interval_variants
        ]
        latents = {
            f"{design.value}, seed {seed}": read_manifest(self._climnet(design, seed)).extra["held_out"]
            for design in self._designs()
            for seed in config.seeds
        }
        path = write_report(self.folder, config, cells, latents, [(s.name, len(s.truth_xywh)) for s in sequences])
        self._say(f"table written to {path}")
        return path

    def _cell(self, variant: Variant, seed: int, interval: int) -> Cell:
        entry = entry_of(self.config, variant, seed, interval)
        scores = json.loads(self._scores(entry).read_text())
        mean = mean_score(Score(**row) for row in scores.values())
        held_out = read_manifest(self._grader(entry.grader, seed)).extra["held_out"]
        return Cell(variant, seed, interval, entry.climnet is not None, mean, held_out)


def _internet(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    return {name: value for name, value in tensors.items() if name.startswith("internet.")}


def _beginning(sequence: recorded.Sequence, frames: int) -> recorded.Sequence:
    if not frames or len(sequence.truth_xywh) <= frames:
        return sequence
    return replace(sequence, truth_xywh=sequence.truth_xywh[:frames], is_part=True)


def _claim(folder: Path, config: AblationConfig) -> None:
    """The folder belongs to one configuration: scores of different budgets must not mix."""
    path = folder / "config.json"
    if path.exists() and json.loads(path.read_text()) != config.to_dict():
        raise TrainConfigError(f"{folder}: holds results of another configuration; choose another --out")
    for name in ("graders", "climnets", "scores"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _write_json(path, config.to_dict())


def _write_json(path: Path, values: Any) -> None:
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(values, indent=1))
    part.replace(path)
