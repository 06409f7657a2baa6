"""`gcs weights train`: arguments to a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from tracker.train.config import TrainConfig, TrainConfigError
from tracker.train.export import export
from tracker.train.loop import Run, Say
from tracker.train.pack import load


def train(values: Mapping[str, Any], data: Path, folder: Path, minutes: float, resume: bool, say: Say) -> bool:
    """Run or go on with a training; True when its schedule is done.

    values: the training configuration (tracker.train.config). data: folder with the packs.
    Raises TrainConfigError and FileNotFoundError with one clear line.
    """
    config = TrainConfig.from_dict(dict(values))
    packs = [data / p for p in config.packs]
    for pack in packs:
        if not pack.exists():
            raise TrainConfigError(f"{pack}: no such pack of training pictures")
    run = Run(config, folder, "cuda" if torch.cuda.is_available() else "cpu", say)
    if resume and (folder / "last.pt").exists():
        run.resume(folder / "last.pt")
        say(f"going on from {folder / 'last.pt'} ({run.samples} samples seen)")
    say("reading pictures")
    imagery, held_out = load(packs), load(packs, split="val")
    say(f"{len(imagery)} pictures, {len(imagery.things)} objects; {len(held_out)} held out")
    done = run.train(imagery, held_out, minutes)
    best = folder / "best.pt"
    path = export(best if best.exists() else folder / "last.pt", folder / "weights.safetensors", data)
    say(f"weights written to {path}")
    return done
