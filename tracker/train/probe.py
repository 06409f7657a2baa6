"""Throughput probe: what each part of a training step takes on this machine, and what starves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from tracker.train.config import Stage, TrainConfig
from tracker.train.dataset import Batch
from tracker.train.devices import Team
from tracker.train.feed import composes_on_gpu, feed
from tracker.train.loop import Run
from tracker.train.pack import Imagery
from tracker.train.progress import Say

DATA_SHARE, STEP_SHARE = 0.2, 0.3  # of the time; the rest is the whole loop's
STARVING_FRAC = 0.15  # of the time spent waiting: more is worth a change


@dataclass(frozen=True, slots=True)
class Costs:
    """Samples per second of one worker making data and of the whole loop; seconds per sample of each part.

    waiting_frac: share of the whole loop's time spent waiting for data.
    """

    made_per_s: float
    transfer_s: float
    forward_s: float
    backward_s: float
    optimizer_s: float
    whole_per_s: float
    waiting_frac: float

    @property
    def step_s(self) -> float:
        """Seconds per sample of everything but making it."""
        return self.transfer_s + self.forward_s + self.backward_s + self.optimizer_s


def probe(config: TrainConfig, imagery: Imagery, team: Team, minutes: float, say: Say) -> list[Costs]:
    """Measure every kind of stage of the configuration in turn and say what it found; nothing is kept."""
    stages = list({(s.kind, s.batch, s.patch_px): s for s in config.stages}.values())
    found = []
    with TemporaryDirectory() as folder:
        for stage in stages:
            one = replace(config, stages=(replace(stage, minutes=1e6, steps=0, epochs=0.0, frozen_epochs=0.0),))
            run = Run(one, Path(folder), team, say)
            costs = measure(run, imagery, minutes * 60 / len(stages))
            found.append(costs)
            for line in report(costs, run.stage, one, team.device, composes_on_gpu(one, imagery, team.device)):
                say(line)
    return found


def measure(run: Run, imagery: Imagery, seconds: float) -> Costs:
    """Costs of the run's stage, in about that many seconds."""
    clock = _Clock(run.device)
    alone = feed(run.stage, replace(run.config, workers=0), imagery, run.device, run.team.rank)
    batch = next(alone)
    made_s = clock.mean(lambda: next(alone), seconds * DATA_SHARE)
    parts = _step_parts(run, batch, clock, seconds * STEP_SHARE)
    whole_s, waiting = _whole(run, imagery, clock, seconds * (1 - DATA_SHARE - STEP_SHARE))
    size = run.stage.batch
    return Costs(size / made_s, *(s / size for s in parts), size / whole_s, waiting)


class _Clock:
    """Times work on a device that may still be busy when the call comes back."""

    def __init__(self, device: torch.device) -> None:
        self._cuda = device if device.type == "cuda" else None

    def now(self) -> float:
        if self._cuda is not None:
            torch.cuda.synchronize(self._cuda)
        return time.perf_counter()

    def mean(self, work: Callable[[], object], seconds: float) -> float:
        began, count = self.now(), 0
        while count == 0 or self.now() - began < seconds:
            work()
            count += 1
        return (self.now() - began) / count


def _step_parts(run: Run, batch: Batch, clock: _Clock, seconds: float) -> tuple[float, float, float, float]:
    """Transfer, forward, backward and optimizer of one batch, seconds each."""
    run.step(batch)  # the first one also chooses algorithms
    totals, count, began = [0.0, 0.0, 0.0, 0.0], 0, clock.now()
    while count == 0 or clock.now() - began < seconds:
        marks = [clock.now()]
        near = {k: v.to(run.device, non_blocking=True) for k, v in batch.items()}
        marks.append(clock.now())
        loss, _ = run.loss(near)
        marks.append(clock.now())
        run.team.backward(loss)
        marks.append(clock.now())
        run.descend()
        marks.append(clock.now())
        totals = [t + b - a for t, a, b in zip(totals, marks[:-1], marks[1:], strict=True)]
        count += 1
    transfer, forward, backward, optimizer = (t / count for t in totals)
    return transfer, forward, backward, optimizer


def _whole(run: Run, imagery: Imagery, clock: _Clock, seconds: float) -> tuple[float, float]:
    """Seconds a step of the real loop, and the share of them spent waiting; the workers' start does not count."""
    source: Iterator[Batch] = feed(run.stage, run.config, imagery, run.device, 1 + run.team.rank)
    for _ in range(2):
        run.step(next(source))
    waited, count, began = 0.0, 0, clock.now()
    while count == 0 or clock.now() - began < seconds:
        asked = clock.now()
        batch = next(source)
        waited += clock.now() - asked
        run.step(batch)
        count += 1
    total = clock.now() - began
    return total / count, waited / total


def report(costs: Costs, stage: Stage, config: TrainConfig, device: torch.device, on_gpu: bool) -> list[str]:
    """The figures of a stage, and one sentence on what starves and what to change."""
    ms = {
        "transfer": costs.transfer_s,
        "forward": costs.forward_s,
        "backward": costs.backward_s,
        "optimizer": costs.optimizer_s,
    }
    parts = ", ".join(f"{name} {1e3 * s:.2f}" for name, s in ms.items())
    return [
        f"{stage.kind.value}, batch {stage.batch} on {device.type}: one maker {costs.made_per_s:.3g} samples/s; "
        f"ms a sample: {parts}; the whole {costs.whole_per_s:.3g} samples/s (waiting {costs.waiting_frac:.0%})",
        verdict(costs, stage, config, device, on_gpu),
    ]


def verdict(costs: Costs, stage: Stage, config: TrainConfig, device: torch.device, on_gpu: bool) -> str:
    """What starves, in one sentence with what to change."""
    able = 1 / costs.step_s
    if costs.waiting_frac > STARVING_FRAC:
        if on_gpu:
            return f"Making samples on the GPU takes {costs.waiting_frac:.0%} of the time: raise batch ({stage.batch})."
        workers = max(config.workers + 1, round(able / costs.made_per_s + 0.5))
        other = ", or compose: gpu" if device.type == "cuda" else ""
        return (
            f"The network starves: it could take {able:.3g} samples/s and gets {costs.whole_per_s:.3g}; "
            f"set workers: {workers} (now {config.workers}) if there are as many free cores{other}."
        )
    if costs.optimizer_s > 0.25 * costs.step_s:
        return (
            f"The optimizer takes {costs.optimizer_s / costs.step_s:.0%} of a step: "
            f"raise batch ({stage.batch}), and the learning rate with it."
        )
    if costs.whole_per_s < 0.7 * able:
        return (
            f"Makers and network share the same cores: alone the network could take {able:.3g} samples/s, together "
            f"it does {costs.whole_per_s:.3g}; set threads + workers (now {config.threads} + {config.workers}) "
            "to the number of cores."
        )
    more = f"raise threads (now {config.threads})" if device.type == "cpu" else f"raise batch ({stage.batch})"
    return f"Nothing starves: the network itself is the limit; {more} if there is room, or add devices."
