"""`gcs`: the command line. Arguments only; each command imports what it needs when it runs.

So `gcs --help` answers at once: neither PyTorch, OpenCV nor MAVSDK is imported for it.
"""

from __future__ import annotations

import argparse
import importlib
import logging
import os
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import NoReturn, TypeAlias

from gcs import cli_keys, cli_scenarios
from gcs.cli_vehicle import add_vehicle
from gcs.errors import EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USAGE, GcsError, one_line

# The libraries raise ValueErrors of their own for bad input; a plain ValueError is a fault of ours.
LIBRARIES = ("tracker", "control", "sitl_mocks", "gcs")


class Parser(argparse.ArgumentParser):
    """Misuse is one line, not a page."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_USAGE, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 our fault, 2 bad input, 130 interrupted."""
    args = build_parser().parse_args(argv)
    debug = bool(getattr(args, "debug", False))
    logging.basicConfig(level=logging.INFO if debug else logging.WARNING, format="gcs: %(message)s")
    # A picture bomb is refused before memory is taken for it; OpenCV reads this when it is first imported.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(4096 * 2160))
    try:
        handler: Callable[[argparse.Namespace], int] = _load(args.handler)
        return handler(args)
    except KeyboardInterrupt:
        print("gcs: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # `gcs ... | head`: nobody reads on; keep the interpreter from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAULT
    except Exception as error:
        if debug:
            raise
        text, status = describe(error)
        print(f"gcs: {text}", file=sys.stderr)
        return status


def describe(error: Exception) -> tuple[str, int]:
    """One line for the user, and the exit status."""
    if isinstance(error, GcsError):
        return one_line(error), error.exit_code
    ours = type(error).__module__.split(".")[0] in LIBRARIES
    if isinstance(error, ValueError) and ours:
        return one_line(error), EXIT_USAGE
    if isinstance(error, OSError) and error.filename is not None:
        return one_line(f"{error.filename}: {error.strerror or error}"), EXIT_USAGE
    kind = type(error).__name__
    return one_line(f"internal fault, {kind}: {error}; --debug shows where"), EXIT_FAULT


def build_parser() -> argparse.ArgumentParser:
    """All commands and their arguments."""
    common = Parser(add_help=False)
    common.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show tracebacks")
    parser = Parser(
        prog="gcs",
        description="Ground control station that tracks one object with ClimRT and follows it over MAVLink.",
        parents=[common],
    )
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    _add_run(commands, common)
    _add_audit(commands, common)
    _add_dry_run(commands, common)
    _add_demo(commands, common)
    _add_weights(commands, common)
    _add_bench(commands, common)
    _add_tune(commands, common)
    _add_config(commands, common)
    cli_keys.add_parser(commands, common)
    cli_scenarios.add_parser(commands, common)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def _add_run(commands: Commands, common: Parser) -> None:
    text = "fly: video and vehicle, a box, a confirmation, follow"
    p = commands.add_parser("run", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.app:main")
    p.add_argument("--video", metavar="URL", help="stream, camera:N or file")
    add_vehicle(p)
    p.add_argument("--box", metavar="x,y,w,h", help="select this at the start; moves nothing")
    p.add_argument("--autopilot", choices=("auto", "px4", "ardupilot"), help="default: what its heartbeat says")
    p.add_argument("--out", metavar="DIR", help="where the recording goes")


def _add_audit(commands: Commands, common: Parser) -> None:
    text = "whether the vehicle's parameters are safe for following; sets nothing; exit status 1 if not"
    p = commands.add_parser("audit", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_audit:main")
    add_vehicle(p)
    p.add_argument("--json", action="store_true", help="one JSON line")


def _add_dry_run(commands: Commands, common: Parser) -> None:
    text = "a video through the whole chain, with no vehicle and no link"
    p = commands.add_parser("dry-run", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_dryrun:main")
    p.add_argument("video", nargs="?", metavar="VIDEO", help="file, image folder, stream or camera:N")
    p.add_argument("--sample", nargs="?", const="", metavar="NAME", help="a recorded sequence that ships with gcs")
    p.add_argument("--box", metavar="x,y,w,h", help="target in the first frame, px")
    p.add_argument("--select", action="store_true", help="draw the box on the first frame in a window")
    p.add_argument("--boxes", metavar="FILE", help="ground truth (x,y,w,h per frame) to score against")
    p.add_argument("--telemetry", metavar="FILE", help="attitude recorded with the video (JSON lines)")
    p.add_argument("--weights", metavar="NAME|FILE", help="default: compact")
    p.add_argument("--config", metavar="FILE", help="configuration (YAML)")
    p.add_argument("--out", metavar="DIR", help="where the results go (default: out/dry-run)")
    p.add_argument("--seconds", type=float, metavar="S", help="stop after this much video")
    p.add_argument("--no-video", action="store_true", help="write no annotated.mp4")
    p.add_argument("--json", action="store_true", help="the summary as one JSON line on stdout")


def _add_demo(commands: Commands, common: Parser) -> None:
    text = "a closed-loop flight of a mocked vehicle in a rendered world"
    p = commands.add_parser("demo", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.demo:main")
    p.add_argument("--seconds", type=float, metavar="N", help="length of the flight")
    p.add_argument("--out", metavar="DIR", help="where video and report go")
    p.add_argument("--scenario", metavar="NAME", help="what the target does")
    p.add_argument("--seed", type=int, metavar="N", help="of the world")
    p.add_argument("--personality", choices=("px4", "ardupilot"), help="which autopilot the mock plays")
    p.add_argument("--gimbal", action="store_true", help="the camera is on a gimbal")
    p.add_argument("--json", action="store_true", help="the result as one JSON line on stdout")


def _add_weights(commands: Commands, common: Parser) -> None:
    text = "import, inspect or train the tracker's weights"
    actions = commands.add_parser("weights", help=text, description=text, parents=[common]).add_subparsers(
        metavar="ACTION", required=True, parser_class=Parser
    )
    p = actions.add_parser("import", help="convert a checkpoint of the authors", parents=[common])
    p.set_defaults(handler="gcs.cli_weights:import_weights")
    p.add_argument("checkpoint", metavar="FILE", help="t_best.pth, model_best.pth or alexnet-bn.pth")
    p.add_argument("--out", metavar="FILE", required=True, help="the .safetensors file to write")
    p.add_argument("--network", default="full", metavar="NAME", help="full or compact (default: full)")
    p = actions.add_parser("info", help="what a weights file holds; checks it", parents=[common])
    p.set_defaults(handler="gcs.cli_weights:info")
    p.add_argument("weights", nargs="?", default="compact", metavar="NAME|FILE")
    _add_train(actions, common)
    _add_ablate(actions, common)
    text = "fit the confidence to held-out clips, as a probability that the box is right; goes into the manifest"
    p = actions.add_parser("calibrate", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_weights:calibrate")
    p.add_argument("weights", metavar="FILE", help="a .safetensors file with its manifest")
    p.add_argument("--data", metavar="DIR", required=True, help="folder with the packs")
    p.add_argument("--packs", nargs="+", metavar="PACK", help="default: all in the folder")


def _add_train(actions: Commands, common: Parser) -> None:
    text = (
        "train weights from packs of pictures. A run goes on with --resume as often as needed, in slices of --minutes: "
        "exit status 3 says that the schedule is not done yet. Several GPUs or machines: start it with torchrun "
        "(torchrun --nproc-per-node N -m gcs.cli weights train ...) or --devices N."
    )
    p = actions.add_parser("train", help="train from packs of pictures", description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_weights:train")
    p.add_argument("settings", metavar="CONFIG", help="YAML file: network, packs, stages (see tracker/train/*.yaml)")
    p.add_argument("--data", metavar="DIR", required=True, help="folder with the packs")
    p.add_argument(
        "--out", metavar="DIR", help="folder for last.pt, best.pt, log.csv, pictures and weights.safetensors"
    )
    text = "leave with everything saved before so many minutes have passed since the command was given"
    p.add_argument("--minutes", type=float, default=float("inf"), metavar="M", help=text)
    p.add_argument("--resume", action="store_true", help="go on from last.pt in --out where there is one")
    text = "begin with the averaged weights of a checkpoint (.pt), a .safetensors file or shipped weights"
    p.add_argument("--from", dest="start_from", default="", metavar="FILE|NAME", help=text)
    p.add_argument("--probe", action="store_true", help="train nothing: measure what is slow here (1 min or --minutes)")
    p.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto", help="default: the GPU if there is one")
    p.add_argument("--devices", type=int, default=1, metavar="N", help="processes here, one device each (default: 1)")


def _add_ablate(actions: Commands, common: Parser) -> None:
    text = (
        "train each of the paper's ablations with the same small budget and score it on sequences, for several seeds: "
        "table.md, table.json and chart.png in --out. A run that was broken off goes on when given again."
    )
    p = actions.add_parser("ablate", help="train and score the paper's ablations", description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_weights:ablate")
    p.add_argument("settings", metavar="CONFIG", help="YAML file (see tracker/train/ablation.yaml)")
    p.add_argument("--data", metavar="DIR", required=True, help="folder with the packs to train on")
    p.add_argument("--eval", metavar="DIR", dest="dataset", required=True, help="sequences to score on")
    p.add_argument("--out", metavar="DIR", required=True, help="folder for weights, scores and tables")


def _add_bench(commands: Commands, common: Parser) -> None:
    text = "measure speed here, or score tracking on sequences"
    bench = commands.add_parser("bench", help=text, description=text, parents=[common])
    bench.set_defaults(handler="gcs.cli_bench:speed")
    bench.add_argument("--json", action="store_true", help="one JSON line")
    kinds = bench.add_subparsers(metavar="KIND", parser_class=Parser)
    _add_bench_track(kinds, common)
    _add_bench_score(kinds, common)


def _add_bench_track(kinds: Commands, common: Parser) -> None:
    text = "one-pass evaluation on a benchmark, a folder of sequences, or one video with boxes"
    p = kinds.add_parser("track", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_bench:track")
    _add_dataset(p)
    p.add_argument("--config", choices=("compact", "full"), help="the shipped configuration (default: compact)")
    p.add_argument("--weights", metavar="FILE", help="weights of your own (.safetensors) instead of those that ship")
    p.add_argument("--results", metavar="DIR", help="keep the boxes there as text; a run broken off goes on from them")
    p.add_argument("--against", metavar="NAME=DIR", action="append", default=[], help="another tracker's boxes; repeat")
    p.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes, one thread each (default: 1, all threads)"
    )
    p.add_argument("--cluster", metavar="ADDRESS", help="a Dask scheduler (tcp://HOST:8786) whose workers do it")
    p.add_argument("--latency", action="store_true", help="score late answers late too, without and with prediction")
    p.add_argument("--fps", type=float, metavar="F", help="with --latency: rate of frames (default: the sequence's)")
    p.add_argument(
        "--slower", type=float, default=1.0, metavar="X", help="with --latency: as on a machine X times slower"
    )


def _add_bench_score(kinds: Commands, common: Parser) -> None:
    text = "score the boxes that any tracker has left as text"
    p = kinds.add_parser("score", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_bench:score")
    _add_dataset(p)
    p.add_argument("--results", metavar="NAME=DIR", action="append", required=True, help="a tracker's boxes; repeat")


def _add_dataset(p: Parser) -> None:
    p.add_argument("dataset", metavar="DATASET", help="folder or video; its layout is recognised")
    p.add_argument("--dataset", dest="layout", metavar="KIND", help="its layout instead: uav123, otb, got10k, ...")
    p.add_argument("--boxes", metavar="FILE", help="ground truth of one video or one folder of pictures")
    p.add_argument("--attributes", action="store_true", help="precision and success by attribute too; plots as well")
    p.add_argument("--plots", metavar="DIR", help="success, precision and centre-error figures there (PNG)")
    p.add_argument("--json", action="store_true", help="one JSON object per line, the mean last")


def _add_tune(commands: Commands, common: Parser) -> None:
    text = "which gains suit your airframe and your video's delay, and what error to expect; flown in simulated time"
    p = commands.add_parser("tune", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_tune:main")
    p.add_argument("--personality", choices=("px4", "ardupilot"), default="px4", help="whose responses (default: px4)")
    p.add_argument("--velocity", metavar="DEAD,TAU", help="your vehicle's answer to a step of velocity, s: 0.20,0.48")
    p.add_argument("--yaw-rate", metavar="DEAD,TAU", help="its answer to a step of yaw rate, s: 0.05,0.45")
    p.add_argument("--delay-ms", type=float, default=100.0, metavar="MS", help="from light to box (default: 100)")
    p.add_argument("--fps", type=float, default=20.0, metavar="N", help="pictures a second (default: 20)")
    p.add_argument("--noise-px", type=float, default=2.0, metavar="PX", help="of the tracker's box (default: 2)")
    p.add_argument("--jobs", type=int, metavar="N", help="flights at a time (default: one for each core)")
    p.add_argument("--out", metavar="FILE", help="write the gains there, as configuration (YAML)")
    p.add_argument("--json", action="store_true", help="one JSON line on stdout")


def _add_config(commands: Commands, common: Parser) -> None:
    text = "print a configuration with every key, or check a file"
    p = commands.add_parser("config", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_config:main")
    p.add_argument("file", nargs="?", metavar="FILE", help="check this file instead")


def _load(name: str) -> Callable[[argparse.Namespace], int]:
    module, _, function = name.partition(":")
    handler: Callable[[argparse.Namespace], int] = getattr(importlib.import_module(module), function)
    return handler


def _version() -> str:
    try:
        return f"gcs {version('climrt-gcs')}"
    except PackageNotFoundError:
        return "gcs (not installed)"


if __name__ == "__main__":
    sys.exit(main())
