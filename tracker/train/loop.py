"""The training loop: stages, steps, averaging of weights, validation, and leaving in time."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from tracker.configs import NETWORKS
from tracker.train import checkpoint, schedule
from tracker.train.clock import Interruption, Slice
from tracker.train.config import Schedule, Stage, StageKind, TrainConfig
from tracker.train.dataset import Batch
from tracker.train.devices import Team
from tracker.train.feed import feed
from tracker.train.journal import Journal
from tracker.train.objective import Objective
from tracker.train.pack import Imagery
from tracker.train.priming import initial_network
from tracker.train.progress import Progress, Say, minutes_text
from tracker.train.schedule import Position
from tracker.train.sheets import held_out_sheet, sample_sheet
from tracker.train.siamese import SiameseResponse
from tracker.train.validation import Examiner

LOG_EVERY_S = 10.0


class Learner(nn.Module):
    """Network and response as one module whose forward pass is the loss: what several processes tie together."""

    def __init__(self, objective: Objective) -> None:
        super().__init__()
        self.network, self.response = objective.network, objective.response
        self._objective = objective
        self.stage: Stage | None = None

    def forward(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """The loss of the stage at hand, and its parts."""
        return self._objective(self.stage, batch)


class Run:
    """A training run in its folder: last.pt to go on from, best.pt by validation, journal, sheets, config.json."""

    def __init__(self, config: TrainConfig, folder: Path, team: Team, say: Say, live: bool = False) -> None:
        self.config, self.folder, self.team, self.device = config, folder, team, team.device
        self.progress = Progress(say if team.leads else _silence, live and team.leads)
        torch.set_num_threads(config.threads)
        torch.set_flush_denormal(True)  # vanishing gradients must not slow every step down
        self.network = initial_network(NETWORKS[config.network], config.seed)
        self.average = deepcopy(self.network).to(self.device).eval()
        self.network = team.prepare(self.network).to(self.device)
        for part in (self.network.backbone, self.network.grader):  # ClimNet's 3-D weights have no such layout
            part.to(memory_format=torch.channels_last)
        self.response = SiameseResponse(self.network.config.backbone_channels[3:]).to(self.device)
        self.objective = Objective(config, self.network, self.response, self.device)
        self.learner = Learner(self.objective)
        self.position = Position()
        self._interruption = Interruption()
        self.interrupted = False
        self.enter_stage()
        if team.leads:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "config.json").write_text(json.dumps(config.to_dict(), indent=1))
            self.journal = Journal(folder, config.tensorboard)

    # -- stages --------------------------------------------------------------------------------------

    @property
    def stage(self) -> Stage:
        """The stage at hand (the last one when all are done)."""
        return self.config.stages[min(self.position.stage, len(self.config.stages) - 1)]

    def enter_stage(self) -> None:
        """Make ready for the stage at hand: optimizer, what learns, the ties between processes."""
        self.optimizer = schedule.make_optimizer(self.stage, self.config, self.network, self.response)
        self.plateau = schedule.make_plateau(self.optimizer)
        self._thawed = self._backbone_learns()
        self._tie()

    def _tie(self) -> None:
        schedule.set_modes(self.stage, self.network, self.response, self._thawed)
        self.learner.stage = self.stage
        self._forward = self.team.wrap(self.learner)

    def _backbone_learns(self) -> bool:
        return self.position.epoch(self.stage, self.config) >= self.stage.frozen_epochs

    def next_stage(self) -> None:
        """Leave the stage; the next one begins with the averaged weights, the best tracker's ahead of ClimNet."""
        position, before = self.position, self.stage.kind
        position.enter(position.stage + 1)
        if position.stage >= len(self.config.stages):
            return
        after = self.stage.kind
        best = self.folder / "best.pt"
        if after is StageKind.CLIMNET and before in (StageKind.HEADS, StageKind.JOINT):
            found = self.team.share(checkpoint.read(best)["average"] if self.team.leads and best.exists() else None)
            if found is not None:
                self.average.load_state_dict(found)
        if {before, after} != {StageKind.HEADS, StageKind.JOINT} and before is not after:
            position.best = float("-inf")  # measured by other figures from now on
            if self.team.leads and best.exists():
                best.replace(self.folder / f"best_{before.value}.pt")
        self.network.load_state_dict(self.average.state_dict())
        self.enter_stage()

    def done(self) -> float:
        """Share of the stage done, 0..1."""
        return self.position.done(self.stage, self.config)

    def rate(self) -> float:
        """The learning rate of the next step."""
        return schedule.rate(self.stage, self.config, self.position, self.optimizer)

    # -- learning ------------------------------------------------------------------------------------

    def step(self, batch: Batch) -> dict[str, float]:
        """One optimizer step; returns the losses."""
        loss, parts = self.loss(batch)
        self.team.backward(loss)
        self.descend()
        return parts

    def loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """The loss to descend, and its parts."""
        if not self._thawed and self._backbone_learns():
            self._thawed = True
            self._tie()
        return self._forward(batch)

    def descend(self) -> None:
        """Use the gradients; one that is not finite is left out, in all processes alike."""
        rate = self.rate()
        for group in self.optimizer.param_groups:
            group["lr"] = rate * group.get("factor", 1.0)
        parameters = [p for g in self.optimizer.param_groups for p in g["params"]]
        if torch.isfinite(nn.utils.clip_grad_norm_(parameters, self.config.gradient_clip)):
            self.optimizer.step()
            self._average()
        self.optimizer.zero_grad(set_to_none=True)

    @torch.no_grad()
    def _average(self) -> None:
        """Move the averaged weights towards the learning ones; what keeps still keeps its average."""
        step = self.position.step
        decay = min(self.config.ema_decay, (1 + step) / (10 + step))
        learning = schedule.learning_parts(self.stage, self.network, self.response)
        parts = tuple(f"{name}." for name, part in self.network.named_children() if part in learning)
        means, now = self.average.state_dict(), self.network.state_dict()
        names = [k for k in means if k.startswith(parts)]
        whole = [k for k in names if not means[k].is_floating_point()]
        real = [k for k in names if means[k].is_floating_point()]
        get_ema_multi_avg_fn(decay)([means[k] for k in real], [now[k] for k in real], None)
        for k in whole:
            means[k].copy_(now[k])

    def train(self, imagery: Imagery, held_out: Imagery | None, slice_: Slice) -> bool:
        """Go on with the schedule until it is done (True), the slice is over, or somebody interrupts.

        held_out: to examine the leader on; None in the other processes.
        """
        examiner = Examiner(held_out, self.config) if self.team.leads else None
        try:
            with self._interruption:
                while self.position.stage < len(self.config.stages):
                    if not self._run_stage(self._feed(imagery), examiner, slice_):
                        self.save("last.pt", slice_)
                        return False
                    self.next_stage()
                    self.save("last.pt", slice_)
        finally:
            self.progress.close()
        return True

    def _feed(self, imagery: Imagery) -> Iterator[Batch]:
        """The stage's batches; every process, stage and resume draws its own."""
        position = self.position
        entropy = (self.config.seed, position.stage, position.samples, self.team.rank)
        seed = int(np.random.SeedSequence(entropy).generate_state(1)[0])
        return feed(self.stage, self.config, imagery, self.device, seed)

    def _run_stage(self, source: Iterator[Batch], examiner: Examiner | None, slice_: Slice) -> bool:
        """Steps until the stage is done (True) or the leader's slice is over or somebody was interrupted."""
        self.progress.reset()
        now = saved = checked = logged = self._agreed_s()
        while self.done() < 1:
            before = now
            batch = next(source)
            waited_s = time.monotonic() - before
            if not self.position.step and self.team.leads:
                sample_sheet(batch, self.folder / f"samples_{self.position.stage + 1}_{self.stage.kind.value}.png")
            parts = self.step(batch)
            leave = self._interruption.stop or (self.team.leads and slice_.over(time.monotonic()))
            now, leave = self.team.agree(time.monotonic(), leave)
            drawn = self.stage.batch * self.team.size
            self.position.count(drawn, now - before)
            self.progress.note(parts, drawn, waited_s)
            slice_.step_s = max(0.9 * slice_.step_s, now - before)
            if now - logged > LOG_EVERY_S:
                self._log()
                logged = now
            if self.progress.due(now):
                self.progress.show(self._line(now), now)
            if leave:
                self.interrupted = not slice_.over(now)
                return False
            due = now - checked > self.config.validate_minutes * 60
            if due or now - saved > self.config.checkpoint_minutes * 60:
                self.save("last.pt", slice_)  # before validation: nothing is lost if the time is cut there
                saved = now
                if due:
                    self._examine(examiner, slice_)
                    checked = now
                now = self._agreed_s()
        self.progress.show(self._line(now), now)
        self._log()
        self._examine(examiner, slice_)
        return True

    def _agreed_s(self) -> float:
        return self.team.agree(time.monotonic(), False)[0]

    # -- keeping and saying --------------------------------------------------------------------------

    def save(self, name: str, slice_: Slice | None = None) -> None:
        """Write a checkpoint, in the leader."""
        if not self.team.leads:
            return
        began = time.monotonic()
        checkpoint.save(self, self.folder / name)
        if slice_ is not None:
            slice_.save_s = time.monotonic() - began

    def _examine(self, examiner: Examiner | None, slice_: Slice) -> None:
        """Figures on held-out clips, if there is time; the best checkpoint is kept, and the plateau told."""
        score = self.team.share(self._score(examiner, slice_) if examiner else None)
        if score is None:
            return
        if self.stage.schedule is Schedule.PLATEAU:
            self.plateau.step(score)
        if score > self.position.best:
            self.position.best = score
            self.save("best.pt", slice_)

    def _score(self, examiner: Examiner, slice_: Slice) -> float | None:
        began = time.monotonic()
        if not slice_.holds_examination(began):
            return None
        figures = examiner.examine(self.average, self.stage.kind, self.device)
        held_out_sheet(examiner, self.average, self.stage.kind, self.folder)
        slice_.examination_s = time.monotonic() - began
        if not figures:
            return None
        self.progress.say("validation  " + "  ".join(f"{k} {v:.3f}" for k, v in figures.items()))
        self.journal.log(self.position.samples, "validation", figures)
        self.journal.draw()
        return examiner.score(figures, self.stage.kind)

    def _log(self) -> None:
        if self.team.leads:
            figures = {"lr": self.rate(), **self.progress.losses.means}
            if self.progress.window.samples:
                figures["samples_per_s"] = self.progress.window.speed(time.monotonic())
            self.journal.log(self.position.samples, self.stage.kind.value, figures)

    def _line(self, now_s: float) -> str:
        """Where the run is, how fast it goes, and how long it will take."""
        window, kind = self.progress.window, self.stage.kind.value
        stage_s = (1 - self.done()) * self.position.seconds / max(self.done(), 1e-6)
        speed = window.speed(now_s)
        all_s = stage_s + sum(self._length_s(s, speed) for s in self.config.stages[self.position.stage + 1 :])
        return (
            f"{kind} {self.done():6.1%}  {self.progress.losses.text()}  {speed:.3g} samples/s "
            f"(waiting {window.waiting(now_s):.0%})  {minutes_text(stage_s)} left, {minutes_text(all_s)} in all"
        )

    def _length_s(self, stage: Stage, speed: float) -> float:
        """How long a stage to come will take, at today's speed where its length is not a time."""
        drawn = stage.epochs * self.config.epoch_samples or stage.steps * stage.batch * self.team.size
        return drawn / speed if drawn and speed else stage.minutes * 60


def _silence(_line: str) -> None:
    """Only the leader speaks."""
