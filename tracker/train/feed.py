"""Where a stage's batches come from: worker processes, or the GPU itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from tracker.train.config import Compose, Stage, StageKind, TrainConfig
from tracker.train.dataset import Batch, batches, triplet_batches, video_clips
from tracker.train.pack import Imagery


def feed(stage: Stage, config: TrainConfig, imagery: Imagery, device: torch.device, seed: int) -> Iterator[Batch]:
    """Endless batches for the stage, the same ones for the same seed where workers = 0.

    ClimNet's are triplets of frames; all others are those of dataset.collate.
    """
    if composes_on_gpu(config, imagery, device):
        return _from_gpu(stage, config, imagery, device, seed)
    pin = device.type == "cuda"
    recipe = config.recipe_of(stage)
    if stage.kind is StageKind.CLIMNET:
        return triplet_batches(
            imagery,
            recipe,
            stage.batch,
            seed,
            config.workers,
            patch_px=stage.patch_px,
            real_frac=stage.real_frac,
            pin=pin,
        )
    return batches(imagery, recipe, stage.batch, seed, config.workers, pin=pin)


def composes_on_gpu(config: TrainConfig, imagery: Imagery, device: torch.device) -> bool:
    """Whether samples are made on the device itself: by choice, or where it is a GPU and the pictures are in memory."""
    if config.compose is Compose.AUTO:
        return device.type == "cuda" and imagery.in_memory
    return config.compose is Compose.GPU


def _from_gpu(stage: Stage, config: TrainConfig, imagery: Imagery, device: torch.device, seed: int) -> Iterator[Batch]:
    from tracker.train.gpu_compose import GpuComposer, gpu_batches  # pictures go to the GPU's memory when it is made

    recipe = config.recipe_of(stage)
    composer = GpuComposer(imagery, device, seed, recipe)
    if stage.kind is not StageKind.CLIMNET:
        yield from gpu_batches(composer, stage.batch)
    # Real triplets are cut by worker processes: whole batches of them take their turn.
    real_frac = stage.real_frac if video_clips(imagery) else 0.0
    workers, side = config.workers, stage.patch_px
    real = triplet_batches(imagery, recipe, stage.batch, seed, workers, patch_px=side, real_frac=1.0, pin=True)
    composed = gpu_batches(composer, stage.batch, middle=True)
    rng = np.random.default_rng(seed)
    while True:
        yield next(real) if rng.random() < real_frac else next(composed)
