"""`gcs tune`: which gains to use for an airframe and a latency, and what error to expect with them."""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from gcs.errors import GcsError
from gcs.scenarios.measure import Row
from gcs.tuning.airframe import StepResponse, airframe, measured
from gcs.tuning.sweep import Job, Tuned, sweep
from sitl_mocks.vehicle import Personality

_LONGEST_MS = 400.0  # of the whole budget: above it no follow is begun


class TuneError(GcsError):
    """What was asked for cannot be flown; the text says why."""


def main(args: argparse.Namespace) -> int:
    """Sweep, tell, and write the configuration."""
    job = _job(args)
    velocity, yaw = measured(job.airframe, yaw=False), measured(job.airframe, yaw=True)
    _say(
        f"airframe: velocity {velocity.dead_s:.2f} + {velocity.tau_s:.2f} s, yaw rate {yaw.dead_s:.2f} + "
        f"{yaw.tau_s:.2f} s (dead time + time constant); {1000 * job.delay_s:.0f} ms from light to box, "
        f"{job.fps:g} pictures a second"
    )
    with ProcessPoolExecutor(args.jobs or os.cpu_count(), get_context("spawn")) as pool:
        tuned = sweep(job, pool, _say)
    if args.json:
        print(json.dumps(_as_json(tuned)))
    else:
        print(_table(tuned))
        print(_yaml(tuned))
    if args.out:
        Path(args.out).write_text(_yaml(tuned) + "\n", encoding="utf-8")
    return 0


def _job(args: argparse.Namespace) -> Job:
    for name, value, low, high in (
        ("--delay-ms", args.delay_ms, 20.0, _LONGEST_MS),
        ("--fps", args.fps, 2.0, 120.0),
        ("--noise-px", args.noise_px, 0.0, 20.0),
    ):
        if not low <= value <= high:
            raise TuneError(f"{name}: {value:g} is not from {low:g} to {high:g}")
    velocity = StepResponse.parse(args.velocity, "--velocity") if args.velocity else None
    yaw = StepResponse.parse(args.yaw_rate, "--yaw-rate") if args.yaw_rate else None
    frame = airframe(Personality(args.personality), velocity, yaw)
    return Job(frame, args.delay_ms / 1000, args.fps, args.noise_px)


def _table(tuned: Tuned) -> str:
    lines = [f"{'path':8} {'mode':10} {'bearing, rms':>16} {'distance, rms':>16} {'smallest':>12}"]
    for each in tuned.expected:
        before, after = each.before, each.after
        bearing = f"{_number(before.bearing_rms_deg, 1)} -> {_number(after.bearing_rms_deg, 1)} deg"
        distance = "held by place"
        if after.distance_rms_frac is not None and before.distance_rms_frac is not None:
            distance = f"{100 * before.distance_rms_frac:.0f} -> {100 * after.distance_rms_frac:.0f} %"
        lines.append(
            f"{each.path:8} {each.mode.value:10} {bearing:>16} {distance:>16} {after.smallest_distance_m:10.1f} m"
        )
    return "\n".join(["with the defaults -> with these gains; target at 5 m/s, 15 m away", *lines])


def _yaml(tuned: Tuned) -> str:
    if not tuned.gains:
        return "# the defaults are best"
    return "\n".join(["control:", "  follow:", *(f"    {name}: {value:g}" for name, value in tuned.gains.items())])


def _as_json(tuned: Tuned) -> dict[str, object]:
    rows = [
        {"path": e.path, "mode": e.mode.value, "before": _row(e.before), "after": _row(e.after)} for e in tuned.expected
    ]
    return {"control": {"follow": dict(tuned.gains)}, "expected": rows}


def _row(row: Row) -> dict[str, object]:
    return {
        "bearing_rms_deg": row.bearing_rms_deg,
        "distance_rms_frac": row.distance_rms_frac,
        "smallest_distance_m": row.smallest_distance_m,
        "on_target_frac": row.on_target_frac,
        "unsafe": row.unsafe,
    }


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
