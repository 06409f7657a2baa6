"""Which weights, engine, threads and latent provider track best on this machine: measured once, then remembered.

The best weights and latent provider that keep up with the wanted frame rate, on as few threads as do: the rest of the
machine decodes, controls, records and shows.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import EngineName, Latent, TrackerConfig
from gcs.engine_choice.measure import Candidate, Measured, measure
from gcs.engine_choice.memory import remember, remembered
from gcs.errors import one_line
from gcs.recorder.facts import usable_cores

BUSY_FRAC: Final = 0.5  # of the time between two pictures; the rest is for decoding, control and showing
ALIKE: Final = 1.15
_THREADS: Final = (1, 2, 4)
Say = Callable[[str], object]


class _Metrics(msgspec.Struct):
    """Of a weights file's manifest, what is asked for here."""

    development_auc: float | None = None
    development_auc_by_latent: dict[Latent, float] = {}


def choose(measured: Sequence[Measured], fps: float, scores: Mapping[tuple[str, str | None], float]) -> Measured:
    """The best by score that keeps up with `fps` pictures a second, else the fastest; scores: by weights and latent.

    measured: of engines that cost about the same the one to prefer first. They are told apart by CPU time, which
    others at work disturb little. ValueError without a candidate.
    """
    if not measured:
        raise ValueError("no way to track could be measured")
    within_ms = 1000.0 / fps * BUSY_FRAC
    able = [each for each in measured if each.update_ms <= within_ms]
    if not able:
        return min(measured, key=lambda each: each.update_ms)

    def rank(each: Measured) -> tuple[float, int]:
        candidate = each.candidate
        return -scores.get((candidate.weights, candidate.latent), 0.0), candidate.threads

    best = min(rank(each) for each in able)
    equals = [each for each in able if rank(each) == best]
    most_ms = min(each.cpu_ms for each in equals) * ALIKE
    return next(each for each in equals if each.cpu_ms <= most_ms)


def chosen(config: TrackerConfig, say: Say) -> TrackerConfig:
    """The configuration with weights, engine, threads and latent provider decided, and said.

    Nothing is measured where the configuration leaves nothing open. Imports PyTorch, else.
    """
    if None not in (config.weights, config.engine, config.threads):
        return config
    candidates = _candidates(config)
    measured = _measured(candidates, {each.candidate: each for each in remembered()}, say)
    best = choose(measured, config.fps, _scores(candidates))
    rate = f"{1000 / best.update_ms:.0f} pictures a second"
    slow = "" if best.update_ms <= 1000 / config.fps else f"; {config.fps:g} were wanted: a slower video, or a GPU"
    say(f"tracker: {best.candidate}: {best.update_ms:.1f} ms a picture here ({rate} at most{slow})")
    return applied(config, best.candidate)


def choose_anew(config: TrackerConfig, say: Say) -> tuple[list[Measured], Measured]:
    """Measure again, whatever is remembered: all that runs here, and the one to take."""
    candidates = _candidates(config)
    measured = _measured(candidates, {}, say)
    return measured, choose(measured, config.fps, _scores(candidates))


def applied(config: TrackerConfig, candidate: Candidate) -> TrackerConfig:
    """The configuration as the candidate has it."""
    latent = config.latent if candidate.latent is None else Latent(candidate.latent)
    return replace(
        config, weights=candidate.weights, engine=EngineName(candidate.engine), threads=candidate.threads, latent=latent
    )


def _candidates(config: TrackerConfig) -> list[Candidate]:
    """What the configuration leaves open, as far as it can run here."""
    from tracker.engines.catalogue import ON_DEVICE, available_engines

    threads = [config.threads] if config.threads is not None else [n for n in _THREADS if n <= usable_cores()]
    engines = [config.engine.value] if config.engine is not None else available_engines()
    return [
        Candidate(weights, engine, count, latent, config.graphs, content)
        for weights in ([config.weights] if config.weights is not None else _shipped())
        for content in [_content(weights, config.graphs)]
        for latent in _latents(weights, config)
        for engine in engines
        for count in (threads if engine not in ON_DEVICE else threads[:1])
    ]


def _shipped() -> list[str]:
    from tracker.weights import DATA

    return sorted(path.stem for path in DATA.glob("*.safetensors"))


def _content(weights: str, graphs: str | None) -> str:
    """What files of the user's own hold; empty for what ships, which changes with the version alone."""
    from tracker.engines.export_files import MANIFEST
    from tracker.weights import DATA, find_weights, read_manifest

    path, found = find_weights(weights), []
    if path.parent != DATA:
        found.append(read_manifest(path).sha256)
    if graphs is not None:
        with contextlib.suppress(OSError):  # whoever loads them says so
            found.append(hashlib.sha256((Path(graphs) / MANIFEST).read_bytes()).hexdigest())
    return " ".join(found)


def _latents(weights: str, config: TrackerConfig) -> list[str | None]:
    """None where the configuration or the weights file decides; else those that score best, the dearer first."""
    if config.latent is not None:
        return [config.latent.value]
    scores = _latent_scores(weights)
    own = scores.get(None)
    better = [latent for latent, score in scores.items() if latent is not None and own is not None and score > own]
    return [*better, None]


def _latent_scores(weights: str) -> dict[str | None, float]:
    """Success on the development sequences by latent provider, None: the weights' own; as their manifest says."""
    from tracker.weights import find_weights, read_manifest

    manifest = read_manifest(find_weights(weights))
    try:  # whatever stands in a manifest from elsewhere: without scores its own provider is taken
        metrics = msgspec.convert(manifest.extra.get("metrics", {}), _Metrics)
    except msgspec.ValidationError:
        return {}
    scores: dict[str | None, float] = {
        latent.value: score for latent, score in metrics.development_auc_by_latent.items()
    }
    own = scores.pop(manifest.tracker.latent.value, metrics.development_auc)
    return scores if own is None else scores | {None: own}


def _scores(candidates: Sequence[Candidate]) -> dict[tuple[str, str | None], float]:
    return {
        (weights, latent): score
        for weights in {each.weights for each in candidates}
        for latent, score in _latent_scores(weights).items()
    }


def _measured(candidates: Sequence[Candidate], known: dict[Candidate, Measured], say: Say) -> list[Measured]:
    """Each that runs, those not known yet measured and kept for the next start.

    What does not run is said and left out, and tried again at the next start. Raises WeightsError; EngineError where
    none runs.
    """
    from tracker.engines.engine import EngineError

    missing = [each for each in candidates if each not in known]
    failed: dict[str, str] = {}
    for number, each in enumerate(missing):
        if number == 1:  # the weights are sound
            say(f"measuring {len(missing)} ways to track on this machine, once ...")
        if each.engine in failed:
            continue
        try:
            known[each] = measure(each)
        except (EngineError, RuntimeError, ImportError) as error:  # of a library that is installed but unusable
            failed[each.engine] = one_line(error)
            say(f"tracker: {each} does not run here: {failed[each.engine]}")
    measured = [known[each] for each in candidates if each in known]
    if not measured:
        raise EngineError(f"none of the {len(candidates)} ways to track runs here: {'; '.join(failed.values())}")
    if any(each in known for each in missing):
        remember([*(each for each in remembered() if each.candidate not in candidates), *measured])
    return measured
