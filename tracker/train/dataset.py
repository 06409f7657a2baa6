"""Batches of composed samples, and of triplets of frames for ClimNet, made by worker processes."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from tracker.train.clips import SLOW_PARTS
from tracker.train.compose import SEARCH_PX, Composer, Recipe
from tracker.train.labels import make_labels
from tracker.train.pack import BrokenPictureError, Imagery

Batch = dict[str, torch.Tensor]
Frames = tuple[np.ndarray, np.ndarray, np.ndarray]

WIDEST_GAP = 2  # frames from the middle of a triplet to its ends
TRIES = 40  # packs keep bursts of frames: many frames have no neighbours


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


class Triplets:
    """Draws previous, middle and next frame: real ones of clips, or composed ones. Deterministic for its seed.

    patch_px: side of the patches, 0 = whole search patches. real_frac: share of real ones, as far as there are any.
    """

    def __init__(self, imagery: Imagery, recipe: Recipe, seed: int, patch_px: int = 0, real_frac: float = 0.5) -> None:
        self.imagery = imagery
        self.side_px = patch_px or SEARCH_PX
        self.rng = np.random.default_rng([seed, 3])
        self._composer = Composer(imagery, seed, recipe, middle=True)
        self._clips = video_clips(imagery) if real_frac else []
        self._shares = np.cumsum([len(imagery.clips[i]) for i in self._clips])
        self.real_frac = real_frac if self._clips else 0.0

    def batch(self, size: int) -> Batch:
        """previous, search and middle, uint8 (B, side, side, 3)."""
        frames = [self.real() if self.rng.random() < self.real_frac else self.composed() for _ in range(size)]
        return {
            name: torch.from_numpy(np.ascontiguousarray(np.stack(some)))
            for name, some in zip(("previous", "middle", "search"), zip(*frames, strict=True), strict=True)
        }

    def real(self) -> Frames:
        """A random square of three frames of a clip at a random zoom, turned over, and run backwards at times."""
        rng = self.rng
        frames = self._adjacent()
        if frames is None:
            return self.composed()
        height, width = frames[0].shape[:2]
        largest = min(height, width)
        least = min(largest, max(self.side_px // 2, 16))
        side = round(np.exp(rng.uniform(np.log(least), np.log(min(largest, 2 * self.side_px) + 1e-6))))
        side = min(max(side, least), largest)
        top, left = rng.integers(height - side + 1), rng.integers(width - side + 1)
        how = cv2.INTER_AREA if side > self.side_px else cv2.INTER_LINEAR
        size = (self.side_px, self.side_px)
        cut = [cv2.resize(f[top : top + side, left : left + side], size, interpolation=how) for f in frames]
        return self._turned((cut[0], cut[1], cut[2]))

    def _adjacent(self) -> list[np.ndarray] | None:
        """Three evenly spaced frames of a video, at most WIDEST_GAP apart; None if chance finds none."""
        for _ in range(TRIES):
            at = np.searchsorted(self._shares, self.rng.integers(self._shares[-1]), side="right")
            clip = self.imagery.clips[self._clips[at]]
            gap, middle = self.rng.integers(1, WIDEST_GAP + 1), self.rng.integers(1, len(clip) - 1)
            trio = [clip[k] for k in (middle - gap, middle, middle + gap) if 0 <= k < len(clip)]
            numbers = [self.imagery.frames[i] for i in trio]
            if len(trio) < 3 or numbers[2] - numbers[0] != 2 * gap or numbers[1] - numbers[0] != gap:
                continue
            try:
                frames = [self.imagery.pyramids[i][0] for i in trio]
            except BrokenPictureError:
                continue
            if len({f.shape for f in frames}) == 1:  # a clip may come from two sources
                return frames
        return None

    def composed(self) -> Frames:
        """The same of a synthetic moment."""
        sample = self._composer.sample()
        top, left = self.rng.integers(SEARCH_PX - self.side_px + 1, size=2)
        rows, columns = slice(top, top + self.side_px), slice(left, left + self.side_px)
        moment = (sample.previous, sample.middle, sample.search)
        return self._turned(tuple(f[rows, columns] for f in moment))

    def _turned(self, frames: Frames) -> Frames:
        if self.rng.random() < 0.5:
            frames = tuple(f[:, ::-1] for f in frames)
        if self.rng.random() < 0.5:
            frames = tuple(f[::-1] for f in frames)
        return frames[::-1] if self.rng.random() < 0.5 else frames


def video_clips(imagery: Imagery) -> list[int]:
    """Indices of the clips whose frames, numbered one by one, are those of a video."""
    return [i for i, c in enumerate(imagery.clips) if len(c) > 2 and imagery.parts[c[0]] not in SLOW_PARTS]


class EndlessBatches(IterableDataset):
    """What `make(seed)` gives, called again and again; each worker has a seed of its own."""

    def __init__(self, make: Callable[[int], Callable[[], Batch]], seed: int) -> None:
        self.make, self.seed = make, seed

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        seed = np.random.SeedSequence((self.seed, worker.id if worker else 0)).generate_state(1)[0]
        draw = self.make(int(seed))
        while True:
            yield draw()


def _loader(make: Callable[[int], Callable[[], Batch]], seed: int, workers: int, pin: bool) -> Iterator[Batch]:
    cv2.setNumThreads(1)  # here, not in the worker: a forked child that inherits OpenCV's pool hangs
    return iter(
        DataLoader(
            EndlessBatches(make, seed),
            batch_size=None,
            num_workers=workers,
            prefetch_factor=6 if workers else None,
            worker_init_fn=_leave_interrupts,
            pin_memory=pin,
            generator=torch.Generator().manual_seed(seed),  # the network's own draws stay as they would be
        )
    )


def _leave_interrupts(_worker: int) -> None:
    """Ctrl-C reaches every process of the terminal: the run's own decides when its workers end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def batches(
    imagery: Imagery,
    recipe: Recipe,
    batch: int,
    seed: int,
    workers: int,
    middle: bool = False,
    *,
    pin: bool = False,
) -> Iterator[Batch]:
    """Endless composed batches from worker processes (0 = in this one). pin: in memory that GPUs read directly."""
    return _loader(partial(_composing, imagery, recipe, batch, middle), seed, workers, pin)


def triplet_batches(
    imagery: Imagery,
    recipe: Recipe,
    batch: int,
    seed: int,
    workers: int,
    *,
    patch_px: int = 0,
    real_frac: float = 0.5,
    pin: bool = False,
) -> Iterator[Batch]:
    """Endless batches of Triplets, from worker processes (0 = in this one)."""
    return _loader(partial(_drawing_triplets, imagery, recipe, batch, patch_px, real_frac), seed, workers, pin)


# At module level, so that they reach worker processes on every system.
def _composing(imagery: Imagery, recipe: Recipe, batch: int, middle: bool, seed: int) -> Callable[[], Batch]:
    return partial(collate, Composer(imagery, seed, recipe, middle), batch)


def _drawing_triplets(
    imagery: Imagery, recipe: Recipe, batch: int, patch_px: int, real_frac: float, seed: int
) -> Callable[[], Batch]:
    return partial(Triplets(imagery, recipe, seed, patch_px, real_frac).batch, batch)
