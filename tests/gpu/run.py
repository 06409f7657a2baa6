"""Every variant on every network, one after the other; a table, a recommendation, a file of all figures."""

from __future__ import annotations

import gc
import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch

from tests.gpu import measure, parity
from tests.gpu.variants import COMPILED, ON_CPU, VARIANTS, Variant
from tests.parity.conftest import official_state_dict
from tracker.configs import FULL, LatentProvider, TrackerConfig
from tracker.engines.eager import EagerEngine
from tracker.network.climrt import ClimRT
from tracker.weights import find_weights, load_network, read_manifest

FRAMES, FRAMES_ON_CPU = 61, 5
PLAIN_SHARE = 0.6  # of the time, for all that need no compiling
MOST_COMPILING_S = 120.0
STAGES = ("upload + cut", "cut again", "embed", "imagine", "compare", "fetch", "decode")


@dataclass(frozen=True, slots=True)
class Settings:
    """networks: full, compact. variants: their names. here: compiled ones in this process. seconds: in all, about."""

    device: torch.device
    networks: tuple[str, ...]
    variants: tuple[str, ...]
    seconds: float
    json: Path | None = None
    here: bool = False

    def chosen(self) -> Iterator[tuple[str, Variant]]:
        """What runs in this process."""
        for network in self.networks:
            for variant in (*VARIANTS, *(COMPILED if self.here else ())):
                if variant.name in self.variants and (self.device.type == "cuda" or variant.name in ON_CPU):
                    yield network, variant


@dataclass(frozen=True, slots=True)
class Row:
    """What was found of one variant. track_px: farthest box, from the authors' (full) or from the CPU's (compact).

    memory_mib: the most that PyTorch held on the GPU. error: why there is nothing else.
    """

    network: str
    variant: str
    speed: measure.Speed | None = None
    stages_ms: dict[str, float] = field(default_factory=dict)
    memory_mib: float = 0.0
    differences: parity.Differences | None = None
    track_px: float = 0.0
    is_near: bool = False
    error: str = ""


class Subject:
    """One network, how it tracks, and what the reference engine on the CPU says of it."""

    def __init__(self, name: str, frames: int) -> None:
        self.name = name
        self.frames = measure.moving_thing(frames)
        if name == "full":
            self.network = ClimRT(FULL).eval().requires_grad_(False)
            self.network.load_state_dict(official_state_dict(), strict=False)
            self.config = TrackerConfig(latent=LatentProvider.CLIMNET)
            self._latent5 = parity.reference_latent5(self.network)
        else:
            weights = find_weights(name)
            self.network, self.config = load_network(weights), read_manifest(weights).tracker
            self._boxes = measure.track(EagerEngine(self.network), self.config, self.frames)

    def row(self, variant: Variant, device: torch.device, seconds: float) -> Row:
        """All figures of one variant, in about so many seconds."""
        on_gpu = device.type == "cuda"
        if on_gpu:
            gc.collect()
            torch.cuda.empty_cache()
            torch.cuda.reset_peak_memory_stats()
        with variant.convolutions():
            engine = variant.make(self.network.to("cpu"), device)
            speed = measure.speed(engine, self.config, self.frames, 0.4 * seconds)
            memory_mib = torch.cuda.max_memory_reserved() / 2**20 if on_gpu else 0.0
            stages = measure.stages_ms(engine, self.config, self.frames, device, 0.3 * seconds)
            limits = parity.LIMITS[variant.precision]
            if self.name == "full":
                differences = parity.differences(engine, device, self._latent5)
                track_px = parity.golden_tracks_px(engine)
                is_near = differences.within(limits)
            else:
                differences, is_near = None, True
                track_px = measure.farthest_px(measure.track(engine, self.config, self.frames), self._boxes)
        is_near = is_near and track_px <= parity.TRACK_LIMITS_PX[variant.precision]
        return Row(self.name, variant.name, speed, stages, memory_mib, differences, track_px, is_near)


def run(settings: Settings) -> int:
    """Measures, prints, writes; 1 if a variant is too far from the reference or did not run."""
    start_s = time.monotonic()
    machine = _machine(settings.device)
    print(f"{machine['device']}, PyTorch {machine['torch']}; ms are wall, medians", flush=True)
    rows: list[Row] = []
    plan = list(settings.chosen())
    subject = None
    for network, variant in plan:
        if subject is None or subject.name != network:
            _say(f"{network}: network, frames, the CPU's answers")
            subject = Subject(network, FRAMES if settings.device.type == "cuda" else FRAMES_ON_CPU)
        _say(f"{network}: {variant.name}")
        try:
            rows.append(subject.row(variant, settings.device, PLAIN_SHARE * settings.seconds / len(plan)))
        except (RuntimeError, TypeError, AssertionError) as error:  # one of them must not end the run
            rows.append(Row(network, variant.name, error=_first_line(error)))
    if not settings.here and settings.device.type == "cuda" and "full" in settings.networks:
        for variant in COMPILED:
            if variant.name in settings.variants:
                _say(f"full: {variant.name}, in a process of its own")
                rows.append(_compiled(variant.name, settings.seconds - (time.monotonic() - start_s)))
    print(table(rows))
    if settings.device.type == "cuda":
        print(advice(rows))
    if settings.json is not None:
        settings.json.write_text(json.dumps({**machine, "rows": [asdict(row) for row in rows]}, indent=1) + "\n")
    return 0 if all(row.is_near for row in rows if not row.variant.startswith("compile")) else 1


def _compiled(name: str, left_s: float) -> Row:
    """The row of a compiled variant, from a process that may take so long."""
    limit_s = min(MOST_COMPILING_S, left_s)
    if limit_s < 20:
        return Row("full", name, error="no time left for it: give --seconds more")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "row.json"
        command = [sys.executable, "-m", "tests.gpu", "--here", "--only", name, "--network", "full", "--json", str(out)]
        try:
            ended = subprocess.run(
                [*command, "--seconds", "20"], timeout=limit_s, capture_output=True, text=True, check=False
            )
        except subprocess.TimeoutExpired:
            return Row("full", name, error=f"not compiled within {limit_s:.0f} s")
        if not out.exists():
            return Row("full", name, error=(ended.stderr.strip().splitlines() or ["ended without a word"])[-1])
        (found,) = json.loads(out.read_text())["rows"]
    speed, differences = found.pop("speed"), found.pop("differences")
    return Row(
        **found,
        speed=measure.Speed(**speed) if speed else None,
        differences=parity.Differences(**differences) if differences else None,
    )


def table(rows: list[Row]) -> str:
    """One line each."""
    head = ["network", "variant", "fps", "p50 ms", "p99 ms", *STAGES, "MiB", "features", "maps", "latent5", "track px"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        if row.speed is None:
            lines.append(f"| {row.network} | {row.variant} | {row.error} |" + " |" * (len(head) - 3))
            continue
        cells = [f"{row.speed.fps:.1f}", f"{row.speed.p50_ms:.2f}", f"{row.speed.p99_ms:.2f}"]
        cells += [f"{row.stages_ms[stage]:.3f}" if stage in row.stages_ms else "" for stage in STAGES]
        cells.append(f"{row.memory_mib:.0f}")
        near = row.differences
        cells += [f"{d:.1e}" for d in asdict(near).values()] if near is not None else [""] * 3
        cells.append(f"{row.track_px:.3g}" + ("" if row.is_near else " TOO FAR"))
        lines.append("| " + " | ".join([row.network, row.variant, *cells]) + " |")
    return "\n".join(lines)


def advice(rows: list[Row]) -> str:
    """Which precision to take: the fastest that is near enough, of the engine's own."""
    lines = []
    for network in dict.fromkeys(row.network for row in rows):
        own = [row for row in rows if row.network == network and row.variant.startswith("graphs") and row.is_near]
        best = max(own, key=lambda row: row.speed.fps if row.speed else 0.0, default=None)
        if best is None or best.speed is None:
            lines.append(f"{network}: no precision is near enough to the reference")
        else:
            lines.append(f"{network}: take {best.variant.removeprefix('graphs ')} ({best.speed.fps:.0f} fps)")
    return "\n".join(lines)


def _machine(device: torch.device) -> dict[str, str]:
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else f"CPU ({platform.machine()}), a check only"
    return {"device": name, "torch": torch.__version__, "numpy": np.__version__}


def _first_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {(str(error).strip().splitlines() or [''])[0][:160]}"


def _say(what: str) -> None:
    print(f"... {what}", file=sys.stderr, flush=True)
