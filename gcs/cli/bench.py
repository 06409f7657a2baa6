"""`gcs bench`, `gcs bench track` and `gcs bench score`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import EXIT_USAGE, ConfigError, one_line

if TYPE_CHECKING:
    from tracker.configs import LatentProvider
    from tracker.eval.benchmark import Results
    from tracker.eval.datasets import Dataset
    from tracker.eval.latency import LatencyConfig
    from tracker.eval.run import Job, Outcome
    from tracker.eval.store import Store


def speed(args: argparse.Namespace) -> int:
    """What each stage costs on this machine."""
    if args.auto:
        return _auto(args)
    from gcs.benchmark.command import main

    return main(args, print, lambda text: print(text, file=sys.stderr))


def _auto(args: argparse.Namespace) -> int:
    """Measure the ways to track, remember them, say which is taken."""
    import json

    from gcs.config import TrackerConfig
    from gcs.engine_choice.choice import choose_anew

    if not (math.isfinite(args.fps) and 1 <= args.fps <= 240):
        raise ConfigError(f"--fps {args.fps}: must be from 1 to 240")
    measured, best = choose_anew(TrackerConfig(fps=args.fps), lambda text: print(one_line(text), file=sys.stderr))
    if args.json:
        rows = [
            {"candidate": str(each.candidate), "update_ms": each.update_ms, "cpu_ms": each.cpu_ms} for each in measured
        ]
        print(json.dumps({"measured": rows, "chosen": str(best.candidate)}))
        return 0
    print(f"{'ms a picture':>14s}{'CPU ms':>9s}")
    for each in measured:
        print(f"{each.update_ms:14.1f}{each.cpu_ms:9.1f}  {each.candidate}{'  <- taken' if each == best else ''}")
    return 0


def track(args: argparse.Namespace) -> int:
    """Run the tracker through a data set and score it; beside it, other trackers' boxes."""
    from tracker.eval.benchmark import run_benchmark
    from tracker.eval.run import Job, Shipped

    if args.jobs < 1:
        raise ConfigError(f"--jobs {args.jobs}: must be 1 or more")
    if args.threads is not None and args.threads < 1:
        raise ConfigError(f"--threads {args.threads}: must be 1 or more")
    if args.cluster is not None and args.latency:
        raise ConfigError("--latency with --cluster: times on shared workers say nothing; run it on one machine")
    if args.sre and (args.latency or args.against or args.attributes or args.plots):
        raise ConfigError("--sre goes without --latency, --against, --attributes and --plots")
    others = [_named(text, "--against") for text in args.against]
    latency = _latency(args)
    dataset = _dataset(args)
    weights = args.weights or args.config or "compact"
    threads = 1 if args.jobs > 1 or args.cluster is not None else args.threads
    job = Job(Shipped(weights, args.engine, threads, _latent(args), args.graphs), threads, latency)
    settings = _settings(args, weights, latency)
    if args.sre:
        return _sre(args, job, dataset, settings)
    store = _store(args, settings, dataset)
    _header(args)
    ours = run_benchmark(
        "ClimRT",
        job,
        dataset,
        lambda outcome: _say_outcome(args, outcome),
        store=store,
        jobs=args.jobs,
        cluster=args.cluster,
    )
    trackers = [ours, *(_read(name, folder, dataset) for name, folder in others)]
    return _close(args, dataset, trackers)


def _sre(args: argparse.Namespace, job: Job, dataset: Dataset, settings: dict[str, Any]) -> int:
    """From twelve first boxes that are a little off: a line each; mean and deviation over what all could score."""
    from dataclasses import replace

    from tracker.eval.benchmark import run_benchmark
    from tracker.eval.report import start_line, starts_lines
    from tracker.eval.starts import SRE

    passes: list[Results] = []
    broken = {each.name: each.reason for each in dataset.broken}  # from every start alike
    _header(args)
    for start in SRE:
        results = run_benchmark(
            "ClimRT",
            replace(job, start=start),
            dataset,
            lambda outcome: None,
            store=_store(args, settings, dataset, start.name),
            jobs=args.jobs,
            cluster=args.cluster,
        )
        passes.append(results)
        broken = {each.name: f"{each.reason} (start {start.name})" for each in results.broken} | broken
        if results.outcomes:
            print(start_line(start.name, results, as_json=args.json), flush=True)
    whole = [replace(each, outcomes=tuple(o for o in each.outcomes if o.name not in broken)) for each in passes]
    if all(each.outcomes for each in whole):
        print(*starts_lines(whole, as_json=args.json), sep="\n")
    for reason in broken.values():
        print(f"gcs: {one_line(reason)}", file=sys.stderr)
    return EXIT_USAGE if broken else 0


def score(args: argparse.Namespace) -> int:
    """Score boxes that are there; a line per sequence for one tracker, per tracker for several."""
    from dataclasses import replace

    named = [_named(text, "--results") for text in args.results]
    dataset = _dataset(args)
    _header(args)
    trackers = [_read(name, folder, dataset) for name, folder in named]
    trackers[0] = replace(trackers[0], broken=(*dataset.broken, *trackers[0].broken))
    if len(trackers) == 1 or args.json:
        for results in trackers:
            for outcome in results.outcomes:
                _say_outcome(args, outcome, results.tracker if len(trackers) > 1 else None)
    return _close(args, dataset, trackers)


def _close(args: argparse.Namespace, dataset: Dataset, trackers: list[Results]) -> int:
    """Everything after the sequences' lines, the first tracker's mean last; 2 where one could not be scored."""
    from tqdm import tqdm

    from tracker.eval.report import attribute_lines, late_lines, mean_line

    scored = [results for results in trackers if results.outcomes]
    if scored and not args.json:
        for results in scored:
            print(mean_line(results, as_json=False, named=len(trackers) > 1))
        for results in scored:
            print(*late_lines(results), sep="\n", end="\n" if results.outcomes[0].late else "")
    if scored and args.attributes:
        print(*attribute_lines(dataset.sequences, scored, as_json=args.json), sep="\n")
    if scored and args.plots is not None:
        from tracker.eval.plots import plot_all

        title = Path(args.dataset).resolve().name
        written = plot_all(Path(args.plots), title, dataset.sequences, scored, attributes=args.attributes)
        count = sum(1 for _ in tqdm(written, desc="figures", unit="", leave=False))
        print(f"{count} figures in {args.plots}", file=sys.stderr)
    if args.json:
        for results in reversed(scored):
            print(mean_line(results, as_json=True, named=len(trackers) > 1))
    broken = [each for results in trackers for each in results.broken]
    for each in broken:
        print(f"gcs: {one_line(each.reason)}", file=sys.stderr)
    return EXIT_USAGE if broken else 0


def _dataset(args: argparse.Namespace) -> Dataset:
    from tracker.eval.datasets import Layout, read_dataset

    kinds = {layout.value: layout for layout in Layout}
    if args.layout is not None and args.layout not in kinds:
        raise ConfigError(f"--dataset {args.layout}: none of {', '.join(kinds)}")
    layout = None if args.layout is None else kinds[args.layout]
    return read_dataset(Path(args.dataset), layout, None if args.boxes is None else Path(args.boxes))


def _latency(args: argparse.Namespace) -> LatencyConfig | None:
    for option, value in (("--fps", args.fps), ("--slower", args.slower)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ConfigError(f"{option} {value}: must be above zero")
    if not args.latency:
        if args.fps is not None or args.slower != 1:
            raise ConfigError("--fps and --slower belong to --latency")
        return None
    from gcs.pixel_kalman import PixelKalman
    from tracker.eval.latency import LatencyConfig

    return LatencyConfig(args.fps, args.slower, PixelKalman)


def _latent(args: argparse.Namespace) -> LatentProvider | None:
    from tracker.configs import LatentProvider

    return None if args.latent is None else LatentProvider(args.latent)


def _settings(args: argparse.Namespace, weights: str, latency: LatencyConfig | None) -> dict[str, Any]:
    """What boxes depend on. Loads the weights once, so that bad ones are refused before anything runs."""
    from tracker.weights import find_weights, load_tracker, read_manifest

    config = load_tracker(
        weights, engine=args.engine, threads=args.threads, latent=_latent(args), graphs=args.graphs
    ).config
    manifest = read_manifest(find_weights(weights))
    if args.config is not None and manifest.network.name != args.config:
        raise ConfigError(f"{weights}: holds the network '{manifest.network.name}', not '{args.config}'")
    clock = None if latency is None else {"fps": latency.fps, "slower": latency.slower}
    settings: dict[str, Any] = {"weights_sha256": manifest.sha256, "tracker": config.to_dict(), "latency": clock}
    if args.engine != "torch":  # what was kept before there were others goes on
        settings["engine"] = args.engine if args.graphs is None else f"{args.engine} {args.graphs}"
    return settings


def _store(args: argparse.Namespace, settings: dict[str, Any], dataset: Dataset, start: str = "") -> Store | None:
    """Where results are kept, if at all; start: kept apart from those of other first boxes."""
    from tracker.eval.datasets import Layout
    from tracker.eval.store import Store

    if args.results is None:
        return None
    if start:
        settings = settings | {"start": start}
    return Store(Path(args.results) / start, settings, as_got10k=dataset.layout is Layout.GOT10K)


def _read(name: str, folder: Path, dataset: Dataset) -> Results:
    from tracker.eval.benchmark import Results
    from tracker.eval.results import read_results

    outcomes, broken = read_results(folder, dataset.sequences)
    return Results(name, tuple(outcomes), tuple(broken))


def _named(text: str, option: str) -> tuple[str, Path]:
    name, separator, folder = text.partition("=")
    if not (name and separator and folder):
        raise ConfigError(f"{option} {text}: must be NAME=DIR")
    return name, Path(folder)


def _header(args: argparse.Namespace) -> None:
    from tracker.eval.report import HEADER

    if not args.json:
        print(HEADER)


def _say_outcome(args: argparse.Namespace, outcome: Outcome, tracker: str | None = None) -> None:
    from tqdm import tqdm

    from tracker.eval.report import outcome_line

    tqdm.write(outcome_line(outcome, as_json=args.json, tracker=tracker))  # past the progress bar
