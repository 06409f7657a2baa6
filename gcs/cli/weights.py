"""`gcs weights import | info | train | ablate`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import yaml

from gcs.errors import ConfigError, one_line
from tracker.checkpoints import import_checkpoint
from tracker.configs import NETWORKS
from tracker.weights import DATA, load_network, read_manifest


def import_weights(args: argparse.Namespace) -> int:
    """Convert a checkpoint of the authors; nothing in it is executed."""
    if args.network not in NETWORKS:
        raise ConfigError(f"--network {args.network}: known are {', '.join(NETWORKS)}")
    if not args.out.endswith(".safetensors"):
        raise ConfigError(f"--out {args.out}: must end in .safetensors")
    imported = import_checkpoint(args.checkpoint, args.out, NETWORKS[args.network])
    print(one_line(f"{imported.path}: {imported.tensors} tensors of {', '.join(imported.parts)}"))
    return 0


def info(args: argparse.Namespace) -> int:
    """What the file holds, after loading it as a flight would."""
    path = Path(args.weights)
    if path.suffix != ".safetensors":
        path = DATA / f"{args.weights}.safetensors"
    manifest = read_manifest(path)
    network = load_network(path)
    parameters = sum(p.numel() for p in network.parameters())
    print(f"file        {path} ({path.stat().st_size / 1e6:.1f} MB)")
    print(f"network     {manifest.network.name}, {parameters / 1e6:.2f} M parameters")
    print(f"parts       {', '.join(manifest.parts)}")
    print(f"latent      {manifest.tracker.latent.value}, interval {manifest.tracker.latent_interval}")
    print(f"sha256      {manifest.sha256} (checked)")
    for key, value in manifest.extra.items():
        if key != "format":
            print(one_line(f"{key:11s} {value}"))
    return 0


def train(args: argparse.Namespace) -> int:
    """Train; 0 when the schedule is done (or probed), 3 when --minutes or an interruption came first."""
    values = _settings(Path(args.settings))
    # Nobody else imports training.
    from tracker.train.cli import Options
    from tracker.train.cli import train as run

    if args.out is None and not args.probe:
        raise ConfigError("--out DIR is needed, the folder for checkpoints and weights")
    options = Options(
        minutes=args.minutes,
        resume=args.resume,
        start_from=args.start_from,
        devices=args.devices,
        device=args.device,
        probe=args.probe,
    )
    done = run(values, Path(args.data), Path(args.out or "."), options, print)
    return 0 if done else 3


def calibrate(args: argparse.Namespace) -> int:
    """Fit the confidence of weights to held-out clips; 0."""
    from tracker.train.calibrate import calibrate as run
    from tracker.train.pack import load

    data = Path(args.data)
    packs = [data / name for name in args.packs] if args.packs else sorted(data.glob("*.tar"))
    if not packs:
        raise ConfigError(f"{data}: no packs of pictures (*.tar) there")
    run(Path(args.weights), load(packs, split="val"), print)
    return 0


def ablate(args: argparse.Namespace) -> int:
    """Train and score the paper's ablations, and print the table."""
    values = _settings(Path(args.settings))
    from tracker.train.ablation import ablate as run

    table = run(values, Path(args.data), Path(args.dataset), Path(args.out), print)
    print(table.read_text(encoding="utf-8"))
    return 0


def _settings(path: Path) -> dict[str, Any]:
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ConfigError(one_line(f"{path}: not valid YAML: {error}")) from error
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: must be a list of `key: value` lines")
    return values
