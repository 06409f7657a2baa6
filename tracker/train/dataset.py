"""Batches of composed samples, made by worker processes."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from tracker.train.compose import Composer, Recipe
from tracker.train.labels import make_labels
from tracker.train.pack import Imagery

Batch = dict[str, torch.Tensor]


def collate(composer: Composer, size: int) -> Batch:
    """uint8 patches (B,H,W,3), boxes (B,4) x1,y1,x2,y2 in search px, positive (B,), and the grids' labels."""
    samples = [composer.sample() for _ in range(size)]
    batch = {
        "template": np.stack([s.template for s in samples]),
        "previous": np.stack([s.previous for s in samples]),
        "search": np.stack([s.search for s in samples]),
        "box": np.array([s.box for s in samples], np.float32),
        "positive": np.array([s.positive for s in samples]),
    }
    labels = [make_labels(s.box, composer.rng) for s in samples]
    for name in labels[0]._fields:
        batch[f"label_{name}"] = np.stack([getattr(x, name) for x in labels])
    for i in np.flatnonzero(~batch["positive"]):  # the template's object is not there: background everywhere
        batch["label_cls1"][i], batch["label_cls2"][i], batch["label_loc_weight"][i] = 0, 0, 0
    if composer.middle:
        batch["middle"] = np.stack([s.middle for s in samples])
    return {k: torch.from_numpy(v) for k, v in batch.items()}


class ComposedBatches(IterableDataset):
    """Endless batches; each worker draws its own samples from the same pictures."""

    def __init__(self, imagery: Imagery, recipe: Recipe, batch: int, seed: int, middle: bool = False) -> None:
        self.imagery, self.recipe, self.batch, self.seed, self.middle = imagery, recipe, batch, seed, middle

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        seed = (self.seed, worker.id if worker else 0)
        composer = Composer(self.imagery, np.random.SeedSequence(seed).generate_state(1)[0], self.recipe, self.middle)
        while True:
            yield collate(composer, self.batch)


def batches(
    imagery: Imagery, recipe: Recipe, batch: int, seed: int, workers: int, middle: bool = False
) -> Iterator[Batch]:
    """Endless batches from worker processes (0 = in this one)."""
    cv2.setNumThreads(1)  # here, not in the worker: a forked child that inherits OpenCV's pool hangs
    data = ComposedBatches(imagery, recipe, batch, seed, middle)
    return iter(DataLoader(data, batch_size=None, num_workers=workers, prefetch_factor=6 if workers else None))
