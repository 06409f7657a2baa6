"""The training loop: stages, mixed precision, averaging of weights, checkpoints, validation, curves."""

from __future__ import annotations

import csv
import json
import math
import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import torch

from tracker.configs import NETWORKS
from tracker.train.compose import Composer, Recipe
from tracker.train.config import Stage, StageKind, TrainConfig
from tracker.train.dataset import Batch, batches, collate
from tracker.train.objective import Objective, initial_network, validate
from tracker.train.pack import Imagery
from tracker.train.siamese import SiameseResponse

Say = Callable[[str], None]


def stage_parameters(stage: Stage, network: torch.nn.Module, response: torch.nn.Module) -> list[torch.nn.Parameter]:
    """What the stage may change."""
    if stage.kind is StageKind.CLIMNET:
        return list(network.internet.parameters())
    parts = [network.backbone, response] + ([network.grader] if stage.kind is StageKind.JOINT else [])
    return [p for part in parts for p in part.parameters()]


def make_optimizer(stage: Stage, config: TrainConfig, network: Any, response: Any) -> torch.optim.AdamW:
    """AdamW; no decay on biases, norms and tables of positions."""
    tables = {id(network.grader.row_embed.weight), id(network.grader.col_embed.weight)}
    parameters = stage_parameters(stage, network, response)
    decayed = [p for p in parameters if p.ndim > 1 and id(p) not in tables]
    plain = [p for p in parameters if p.ndim <= 1 or id(p) in tables]
    groups = [
        {"params": decayed, "weight_decay": config.weight_decay},
        {"params": plain, "weight_decay": 0.0},
    ]
    return torch.optim.AdamW(groups, lr=stage.learning_rate, betas=(0.9, 0.98))


class Run:
    """A training run in its folder: last.pt to go on from, best.pt by validation, log.csv, config.json."""

    def __init__(self, config: TrainConfig, folder: Path, device: str, say: Say) -> None:
        self.config, self.folder, self.say = config, folder, say
        self.device = torch.device(device)
        torch.set_num_threads(config.threads)
        torch.set_flush_denormal(True)  # vanishing gradients must not slow every step down
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "config.json").write_text(json.dumps(config.to_dict(), indent=1))
        self.network = initial_network(NETWORKS[config.network], config.seed).to(self.device)
        for part in (self.network.backbone, self.network.grader):  # ClimNet's 3-D weights have no such layout
            part.to(memory_format=torch.channels_last)
        self.response = SiameseResponse(self.network.config.backbone_channels[3:]).to(self.device)
        self.average = deepcopy(self.network).eval()
        self.objective = Objective(config, self.network, self.response, self.device)
        self.stage_index, self.stage_step, self.stage_s, self.samples = 0, 0, 0.0, 0
        self.best = -math.inf
        self.optimizer = self._optimizer()

    def _optimizer(self) -> torch.optim.AdamW:
        return make_optimizer(
            self.config.stages[min(self.stage_index, len(self.config.stages) - 1)],
            self.config,
            self.network,
            self.response,
        )

    # -- keeping -------------------------------------------------------------------------------------

    def save(self, name: str) -> None:
        """Everything needed to go on, written whole or not at all."""
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "response": self.response.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "position": [self.stage_index, self.stage_step, self.stage_s, self.samples, self.best],
            "rng": torch.get_rng_state(),
            "config": json.dumps(self.config.to_dict()),
        }
        torch.save(state, self.folder / f"{name}.part")
        (self.folder / f"{name}.part").replace(self.folder / name)

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint of the same network; raises ValueError where it does not fit."""
        state = torch.load(path, weights_only=True, map_location=self.device)
        try:
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self.response.load_state_dict(state["response"])
            index, self.stage_step, self.stage_s, self.samples, self.best = state["position"]
            self.stage_index = int(index)
            self.optimizer = self._optimizer()
            self.optimizer.load_state_dict(state["optimizer"])
        except (KeyError, RuntimeError, ValueError) as error:
            raise ValueError(f"{path}: not a checkpoint of this run ({str(error).splitlines()[0]})") from error
        torch.set_rng_state(state["rng"].cpu())

    # -- learning ------------------------------------------------------------------------------------

    def progress(self, stage: Stage) -> float:
        """Share of the stage done, 0..1: by steps where the stage names them, else by training time."""
        return self.stage_step / stage.steps if stage.steps else self.stage_s / (stage.minutes * 60)

    def rate(self, stage: Stage) -> float:
        """Warm-up, then half a cosine down to a hundredth."""
        warm = min(1.0, (self.stage_step + 1) / self.config.warmup_steps)
        cosine = 0.5 * (1 + math.cos(math.pi * min(1.0, self.progress(stage))))
        return stage.learning_rate * warm * (0.01 + 0.99 * cosine)

    def step(self, stage: Stage, batch: Batch) -> dict[str, float]:
        """One optimizer step; a step whose loss is not finite is left out."""
        self._set_modes(stage)
        for group in self.optimizer.param_groups:
            group["lr"] = self.rate(stage)
        self.optimizer.zero_grad(set_to_none=True)
        loss, parts = self.objective(stage, batch)
        if not torch.isfinite(loss):
            return parts
        loss.backward()
        parameters = [p for g in self.optimizer.param_groups for p in g["params"]]
        torch.nn.utils.clip_grad_norm_(parameters, self.config.gradient_clip)
        self.optimizer.step()
        self._average()
        return parts

    def _set_modes(self, stage: Stage) -> None:
        self.network.train()
        for i in range(1, 6):
            layer = getattr(self.network.backbone, f"layer{i}")
            frozen = i <= stage.frozen_layers
            layer.requires_grad_(not frozen)
            layer.train(not frozen)

    @torch.no_grad()
    def _average(self) -> None:
        decay = min(self.config.ema_decay, (1 + self.stage_step) / (10 + self.stage_step))
        for mean, now in zip(self.average.state_dict().values(), self.network.state_dict().values(), strict=True):
            if mean.is_floating_point():
                mean.lerp_(now, 1 - decay)
            else:
                mean.copy_(now)

    def train(self, imagery: Imagery, held_out: Imagery, minutes: float) -> bool:
        """Train for at most `minutes`; True when the whole schedule is done."""
        exam = exam_batches(held_out, self.config)
        deadline = time.monotonic() + minutes * 60
        while self.stage_index < len(self.config.stages):
            stage = self.config.stages[self.stage_index]
            if not self._run_stage(stage, imagery, exam, deadline):
                return False
            self.stage_index, self.stage_step, self.stage_s = self.stage_index + 1, 0, 0.0
            if self.stage_index < len(self.config.stages):
                self.optimizer = self._optimizer()
            self.save("last.pt")
        return True

    def _run_stage(self, stage: Stage, imagery: Imagery, exam: list[Batch], deadline: float) -> bool:
        seed = self.config.seed * 1000 + self.stage_index * 100 + self.samples % 97
        middle = stage.kind is StageKind.CLIMNET
        source = batches(imagery, self._recipe(), stage.batch, seed, self.config.workers, middle)
        saved = checked = time.monotonic()
        while self.progress(stage) < 1:
            began = time.monotonic()
            batch = next(source)
            waited = time.monotonic() - began
            parts = self.step(stage, batch)
            now = time.monotonic()
            self.stage_step += 1
            self.samples += stage.batch
            self.stage_s += now - began
            if self.stage_step % 50 == 0:
                self._report(stage, parts, now - began, waited)
            if now - checked > self.config.validate_minutes * 60:
                self._examine(stage, exam)
                checked = time.monotonic()
            if now - saved > self.config.checkpoint_minutes * 60:
                self.save("last.pt")
                saved = time.monotonic()
            if now > deadline:
                self.save("last.pt")
                return False
        self._examine(stage, exam)
        return True

    def _recipe(self) -> Recipe:
        return Recipe(**self.config.recipe)

    def _report(self, stage: Stage, parts: dict[str, float], step_s: float, waited_s: float) -> None:
        left = (1 - self.progress(stage)) * (self.stage_s / max(self.progress(stage), 1e-6)) / 60
        figures = "  ".join(f"{k} {v:.3f}" for k, v in parts.items())
        speed = stage.batch / step_s
        self.say(
            f"{stage.kind.value} {self.progress(stage):6.1%}  step {self.stage_step}  {figures}  "
            f"{speed:.0f} samples/s (waiting {waited_s / step_s:.0%})  {left:.0f} min left"
        )
        self._log({"stage": stage.kind.value, "samples": self.samples, "lr": self.rate(stage), **parts})

    def _examine(self, stage: Stage, exam: list[Batch]) -> None:
        if stage.kind is not StageKind.JOINT:
            return
        figures = validate(self.average, exam, self.device)
        self.say("validation  " + "  ".join(f"{k} {v:.3f}" for k, v in figures.items()))
        self._log({"stage": "validation", "samples": self.samples, **figures})
        if figures["mean_iou"] > self.best:
            self.best = figures["mean_iou"]
            self.save("best.pt")

    def _log(self, row: dict[str, Any]) -> None:
        columns = ["time", "stage", "samples", "lr", "siamese", "loc", "cls1", "cls2", "l1", "psnr_db"]
        columns += ["hit_rate", "mean_iou"]
        path = self.folder / "log.csv"
        new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, columns)
            if new:
                writer.writeheader()
            writer.writerow({"time": f"{time.time():.1f}", **row})


def exam_batches(held_out: Imagery, config: TrainConfig) -> list[Batch]:
    """The same held-out samples every time."""
    composer = Composer(held_out, 20_000 + config.seed, Recipe(**config.recipe))
    return [collate(composer, 32) for _ in range(max(1, config.validation_samples // 32))]
