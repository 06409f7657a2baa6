"""What a stage may change, who takes the steps, and the learning rate on the way: ours and the authors'."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from tracker.train.config import Optimizer, Schedule, Stage, StageKind, TrainConfig

PAPER_EPOCHS, PAPER_WARM_EPOCHS = 70, 5
PLATEAU_FACTOR, PLATEAU_PATIENCE = 0.5, 5


@dataclass
class Position:
    """Where in its schedule a run is. step, seconds and stage_samples count from the start of the stage."""

    stage: int = 0
    step: int = 0
    seconds: float = 0.0
    samples: int = 0
    best: float = float("-inf")
    stage_samples: int = 0

    def enter(self, stage: int) -> None:
        """The beginning of a stage."""
        self.stage, self.step, self.seconds, self.stage_samples = stage, 0, 0.0, 0

    def count(self, samples: int, seconds: float) -> None:
        """One step done."""
        self.step, self.seconds = self.step + 1, self.seconds + seconds
        self.samples, self.stage_samples = self.samples + samples, self.stage_samples + samples

    def done(self, stage: Stage, config: TrainConfig) -> float:
        """Share of the stage done, 0..1: by samples where it has epochs, by steps, else by training time."""
        if stage.epochs:
            return self.stage_samples / (stage.epochs * config.epoch_samples)
        return self.step / stage.steps if stage.steps else self.seconds / (stage.minutes * 60)

    def epoch(self, stage: Stage, config: TrainConfig) -> float:
        """Epochs of the stage done; a stage without has as many as the authors' schedule."""
        return self.done(stage, config) * (stage.epochs or PAPER_EPOCHS)


def learning_parts(stage: Stage, network: Any, response: nn.Module) -> list[nn.Module]:
    """The modules that the stage changes."""
    return {
        StageKind.BACKBONE: [network.backbone, response],
        StageKind.HEADS: [network.grader],
        StageKind.JOINT: [network.backbone, response, network.grader],
        StageKind.CLIMNET: [network.internet],
    }[stage.kind]


def set_modes(stage: Stage, network: Any, response: nn.Module, thawed: bool = True) -> None:
    """Let what the stage changes learn; all else keeps still, batch statistics included.

    thawed: False keeps the whole backbone still (the authors' first epochs).
    """
    learning = learning_parts(stage, network, response)
    for part in (network.backbone, network.grader, network.internet, response):
        if part is not None:
            part.requires_grad_(part in learning)
            part.train(part in learning)
    if network.backbone in learning:
        for i in range(1, 6):
            layer = getattr(network.backbone, f"layer{i}")
            frozen = i <= stage.frozen_layers or not thawed
            layer.requires_grad_(not frozen)
            layer.train(not frozen)


def make_optimizer(stage: Stage, config: TrainConfig, network: Any, response: nn.Module) -> torch.optim.Optimizer:
    """The stage's optimizer; its groups carry `factor`, their learning rate as a multiple of the stage's."""
    decay = config.weight_decay if stage.weight_decay is None else stage.weight_decay
    tables = {id(p) for name, p in network.grader.named_parameters() if "_embed." in name}  # of positions
    groups: list[dict[str, Any]] = []
    for factor in sorted({1.0, stage.backbone_rate}, reverse=True):
        parts = [
            part
            for part in learning_parts(stage, network, response)
            if factor == (stage.backbone_rate if part is network.backbone else 1.0)
        ]
        parameters = [p for part in parts for p in part.parameters()]
        spared = {id(p) for p in parameters if p.ndim <= 1} | tables if stage.optimizer is Optimizer.ADAMW else set()
        for some, weight_decay in (
            ([p for p in parameters if id(p) not in spared], decay),
            ([p for p in parameters if id(p) in spared], 0.0),
        ):
            if some:
                group = {"params": some, "weight_decay": weight_decay, "factor": factor}
                groups.append(group | {"lr": stage.learning_rate * factor})
    if stage.optimizer is Optimizer.SGD:
        return torch.optim.SGD(groups, lr=stage.learning_rate, momentum=0.9)
    if stage.optimizer is Optimizer.ADAM:
        return torch.optim.Adam(groups, lr=stage.learning_rate, betas=(0.9, 0.99))
    return torch.optim.AdamW(groups, lr=stage.learning_rate, betas=(0.9, 0.98))


def make_plateau(optimizer: torch.optim.Optimizer) -> torch.optim.lr_scheduler.ReduceLROnPlateau:
    """Halves the rate when 5 scores (higher is better) in a row bring nothing new (spec.md section 3)."""
    return torch.optim.lr_scheduler.ReduceLROnPlateau(
        optimizer, mode="max", factor=PLATEAU_FACTOR, patience=PLATEAU_PATIENCE
    )


def rate(stage: Stage, config: TrainConfig, position: Position, optimizer: torch.optim.Optimizer) -> float:
    """The learning rate of the next step; groups learn at `factor` times it."""
    if stage.schedule is Schedule.PLATEAU:
        return max(group["lr"] / group.get("factor", 1.0) for group in optimizer.param_groups)
    if stage.schedule is Schedule.PAPER:
        epochs = round(stage.epochs) or PAPER_EPOCHS
        return stage.learning_rate * paper_factor(int(position.epoch(stage, config)), epochs)
    return stage.learning_rate * cosine_factor(position.done(stage, config), position.step, config.warmup_steps)


def cosine_factor(progress: float, step: int, warmup_steps: int) -> float:
    """Warm-up by steps, then half a cosine down to a hundredth. progress: share of the stage done."""
    warm = min(1.0, (step + 1) / warmup_steps)
    cosine = 0.5 * (1 + math.cos(math.pi * min(1.0, progress)))
    return warm * (0.01 + 0.99 * cosine)


def paper_factor(epoch: int, epochs: int = PAPER_EPOCHS) -> float:
    """The authors' table relative to its peak 0.01: 0.005 * 2^(k/5) in 5 epochs, then 0.01 to 1e-4 (spec.md 3).

    epoch counts from 0 and is held at the last one.
    """
    epoch = min(epoch, epochs - 1)
    if epoch < PAPER_WARM_EPOCHS:
        return 0.5 * 2 ** (epoch / PAPER_WARM_EPOCHS)
    return 0.01 ** ((epoch - PAPER_WARM_EPOCHS) / max(epochs - PAPER_WARM_EPOCHS - 1, 1))
