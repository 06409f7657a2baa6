"""Flights drawn by lot: is it ever too near, ever unsafe, and does it find a target again that was hidden?"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from control.config import FollowConfig
from gcs.scenarios import actors
from gcs.scenarios.catalogue import Scenario
from gcs.scenarios.conditions import Conditions
from gcs.scenarios.measure import Row
from gcs.scenarios.run import fly
from gcs.scenarios.sweep import Say, in_processes
from sitl_mocks.vehicle import Personality

HIDDEN_S: Final = 2.0
LEAST_FOUND_FRAC: Final = 0.95
_IN_TIME_S: Final = 5.0  # after it shows up again


@dataclass(frozen=True, slots=True)
class Drawn:
    """One of them, by its seed."""

    seed: int
    row: Row


def random_flight(seed: int) -> Drawn:
    """Motion, distance, size, delay, pictures a second, wind, loss, autopilot: all drawn from the seed."""
    rng = random.Random(seed)
    hidden_s = rng.uniform(4.0, 20.0)
    scenario = Scenario(
        f"random {seed}",
        "whatever comes",
        actors.wanderer,
        height_m=rng.uniform(4.0, 9.0),
        duration_s=30.0,
        settle_s=4.0,
        covered=((hidden_s, hidden_s + rng.uniform(0.1, 2.5)),) if rng.random() < 0.4 else (),
    )
    wind_mps, wind_rad = rng.uniform(0.0, 6.0), rng.uniform(-math.pi, math.pi)
    conditions = Conditions(
        seed=seed,
        delay_s=rng.uniform(0.05, 0.3),
        delay_error_s=rng.uniform(-0.03, 0.03),
        fps=rng.uniform(8.0, 25.0),
        noise_px=rng.uniform(0.5, 3.0),
        personality=rng.choice(list(Personality)),
        wind_ned_mps=(wind_mps * math.cos(wind_rad), wind_mps * math.sin(wind_rad), 0.0),
        gust_mps=rng.uniform(0.0, 0.6),
        loss_frac=rng.choice((0.0, 0.0, 0.05, 0.15)),
    )
    return Drawn(seed, fly(scenario, conditions))


def occlusion_flight(seed: int) -> Drawn:
    """A straight run in any direction, and nothing to be seen of it for two seconds."""
    rng = random.Random(seed)
    speed_mps, heading_deg, hidden_s = rng.uniform(1.0, 5.0), rng.uniform(-80.0, 80.0), rng.uniform(8.0, 11.0)
    scenario = Scenario(
        f"occlusion {seed}",
        "hidden for 2 s",
        actors.straight(((0.0, 0.0), (2.0, speed_mps)), heading_deg),
        duration_s=hidden_s + HIDDEN_S + _IN_TIME_S,
        covered=((hidden_s, hidden_s + HIDDEN_S),),
    )
    return Drawn(seed, fly(scenario, replace(Conditions(), seed=seed)))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Words for people, and whether all was well."""

    text: str
    passed: bool


def random_flights(count: int, jobs: int, say: Say, first_seed: int = 1) -> Verdict:
    """So many; none may come nearer than the least distance, none may do anything unsafe."""
    least_m = FollowConfig().min_distance_m
    drawn = _all(random_flight, count, jobs, say, first_seed)
    flown = [each for each in drawn if not each.row.refusal]
    if not flown:
        return Verdict("none of them was flown: " + drawn[0].row.refusal, False)
    nearest = min(flown, key=lambda each: each.row.approached_m)
    worst = max(flown, key=lambda each: each.row.bearing_rms_deg if math.isfinite(each.row.bearing_rms_deg) else 0.0)
    near = [each.seed for each in flown if each.row.approached_m < least_m]
    unsafe = [each for each in drawn if each.row.unsafe]
    words = [
        f"{len(flown)} of {count} random flights flown, {count - len(flown)} refused",
        f"nearest that the vehicle flew towards it: {nearest.row.approached_m:.2f} m (seed {nearest.seed}); "
        f"under {least_m:g} m: {len(near)}" + (f", seeds {near[:10]}" if near else ""),
        f"nearest at all, where the target itself came: {min(each.row.smallest_distance_m for each in flown):.2f} m",
        f"worst bearing {worst.row.bearing_rms_deg:.1f} deg rms (seed {worst.seed})",
        f"unsafe events: {sum(each.row.unsafe for each in unsafe)}",
        *(f"  seed {each.seed}: {each.row.reasons[0]}" for each in unsafe[:5]),
    ]
    return Verdict("\n".join(words), not near and not unsafe)


def occlusions(count: int, jobs: int, say: Say, first_seed: int = 1) -> Verdict:
    """So many; in nearly all of them it must follow again."""
    drawn = _all(occlusion_flight, count, jobs, say, first_seed)
    lost = [each.seed for each in drawn if each.row.reacquire_s is None or not math.isfinite(each.row.reacquire_s)]
    unsafe = sum(each.row.unsafe for each in drawn)
    times_s = sorted(each.row.reacquire_s or 0.0 for each in drawn if each.seed not in lost)
    median = f"{times_s[len(times_s) // 2]:.2f} s after it showed up" if times_s else "never"
    text = (
        f"followed again after {HIDDEN_S:g} s hidden: {count - len(lost)} of {count}, median {median}; unsafe {unsafe}"
    )
    return Verdict(
        text + (f"; not: seeds {lost[:20]}" if lost else ""), len(lost) <= (1 - LEAST_FOUND_FRAC) * count and not unsafe
    )


def _all(flight: Callable[[int], Drawn], count: int, jobs: int, say: Say, first_seed: int) -> Sequence[Drawn]:
    drawn = []
    for each in in_processes(flight, range(first_seed, first_seed + count), jobs):
        drawn.append(each)
        row = each.row
        text = f"{row.bearing_rms_deg:.2f} deg, flew up to {row.approached_m:.2f} m, {row.state.value}"
        say(f"{len(drawn)}/{count} seed {each.seed}: {row.refusal or text}")
    return drawn
