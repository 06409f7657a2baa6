"""`gcs weights export`: the network as graphs for other runtimes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import ConfigError, one_line

if TYPE_CHECKING:
    from tracker.configs import TrackerConfig
    from tracker.engines.export import Graphs


def export_weights(args: argparse.Namespace) -> int:
    """Write the graphs and their manifest into --out, and say what was written."""
    from tracker.engines.export import export
    from tracker.engines.export_files import write_files
    from tracker.weights import find_weights, load_network, read_manifest

    if bool(args.int8) != bool(args.frames):
        raise ConfigError("--int8 and --frames belong together: videos, each with its boxes in a .txt beside it")
    path = find_weights(args.weights)
    manifest = read_manifest(path)
    graphs = export(load_network(path))
    facts: dict[str, object] = {"weights": path.name, "weights_sha256": manifest.sha256}
    if args.int8:
        graphs, facts["calibration"] = _in_int8(args, graphs, manifest.tracker)
    files = graphs.files()
    if args.to == "openvino":
        from tracker.engines.openvino import as_ir

        files = as_ir(files)
    written = write_files(args.out, graphs, files, facts)
    for name, content in files.items():
        print(f"{Path(args.out) / name}  {len(content) / 1e6:.2f} MB")
    print(one_line(f"{written}: {manifest.network.name}, {graphs.precision}, of {path.name}"))
    return 0


def _in_int8(args: argparse.Namespace, graphs: Graphs, config: TrackerConfig) -> tuple[Graphs, dict[str, object]]:
    """With embed in 8 bits, and how that was calibrated."""
    from tqdm import tqdm

    from tracker.engines.quantise import Calibration, quantised
    from tracker.engines.quantise_frames import footage, search_patches

    if args.patches < 1:
        raise ConfigError(f"--patches {args.patches}: must be 1 or more")
    if not 1 <= args.layers <= 5:
        raise ConfigError(f"--layers {args.layers}: must be in 1..5")
    videos = footage([Path(video) for video in args.frames])
    with tqdm(total=sum(map(len, videos)), desc="frames", unit="", leave=False) as bar:
        patches = search_patches(videos, args.patches, config, bar.update)
    print(f"calibrating on {len(patches)} patches ...", file=sys.stderr)
    method = Calibration[args.calibration.upper()]
    names = [video.frames.name for video in videos]
    facts = {"layers": args.layers, "method": args.calibration, "patches": len(patches), "videos": names}
    return quantised(graphs, patches, method, args.layers), facts
