"""Arguments of the commands that measure: bench, scenarios."""

from __future__ import annotations

from gcs.cli.parser import Commands, Parser, add_actions, add_command

BENCH_GROUPS = (
    "trackers",
    "stages",
    "age",
    "growth",
    "memory",
)  # of gcs.benchmark.run, which must not be imported here


def add(commands: Commands) -> None:
    """The commands."""
    _add_bench(commands)
    _add_scenarios(commands)


def _add_bench(commands: Commands) -> None:
    bench = add_command(
        commands, "bench", "how fast it is here, or how well it tracks",
        handler="gcs.cli.bench:speed",
        more="Alone it measures speed and memory on this machine, side by side with other trackers: four minutes.",
        examples=(
            "gcs bench",
            "gcs bench --quick --only trackers stages",
            "gcs bench --auto --fps 60",
            "gcs bench --nano nanotrack_backbone_sim.onnx nanotrack_head_sim.onnx",
            "gcs bench track UAV123_10fps --results boxes --jobs 4",
            "gcs bench score UAV123_10fps --results AutoTrack=boxes/autotrack",
        ),
    )  # fmt: skip
    _add_bench_speed(bench)
    kinds = add_actions(bench, "KIND", required=False)
    _add_bench_track(kinds)
    _add_bench_score(kinds)


def _add_bench_speed(p: Parser) -> None:
    p.add_argument("--json", action="store_true", help="one JSON line")
    p.add_argument("--out", metavar="DIR", default="out/bench", help="table, JSON and plot go there (out/bench)")
    p.add_argument("--quick", action="store_true", help="less of everything: a minute, and rougher")
    p.add_argument("--only", nargs="+", choices=BENCH_GROUPS, metavar="GROUP", help=f"of {', '.join(BENCH_GROUPS)}")
    p.add_argument("--nano", nargs=2, metavar=("BACKBONE", "HEAD"), help="networks of OpenCV's TrackerNano (.onnx)")
    p.add_argument("--vit", metavar="FILE", help="network of OpenCV's TrackerVit (.onnx)")
    p.add_argument("--no-contrib", action="store_true", help="without CSRT and KCF, which are installed aside by pip")
    p.add_argument(
        "--auto", action="store_true",
        help="instead measure every way to track that runs here, and remember which is best: what gcs run, demo,"
        " dry-run and doctor do by themselves the first time",
    )  # fmt: skip
    p.add_argument(
        "--fps", type=float, default=30.0, metavar="F", help="with --auto: pictures a second to keep up with (30)"
    )
    p.add_argument("--update-reference", action="store_true", help="what is measured now becomes the reference")


def _add_bench_track(kinds: Commands) -> None:
    p = add_command(
        kinds, "track", "one-pass evaluation of the tracker on sequences",
        handler="gcs.cli.bench:track",
        more="A benchmark, a folder of sequences, or one video with its boxes.",
        examples=(
            "gcs bench track UAV123_10fps --results boxes --jobs 4",
            "gcs bench track video.mp4 --boxes truth.txt",
            "gcs bench track UAV123_10fps --sre --jobs 4",
            "gcs bench track OTB100 --against AutoTrack=boxes/autotrack --plots figures",
        ),
    )  # fmt: skip
    _add_dataset(p)
    p.add_argument("--config", choices=("compact", "full"), help="the shipped configuration (default: compact)")
    p.add_argument("--weights", metavar="FILE", help="weights of your own (.safetensors) instead of those that ship")
    p.add_argument(
        "--engine", metavar="NAME", default="torch", help="what runs the network (default: torch, the reference)"
    )
    p.add_argument(
        "--latent", choices=("climnet", "previous", "off"), help="the latent frame (default: the weights' own)"
    )
    p.add_argument("--graphs", metavar="DIR", help="run what gcs weights export has made of the weights")
    p.add_argument(
        "--threads", type=int, metavar="N", help="CPU threads of the engine (default: all for torch, else 1)"
    )
    p.add_argument("--results", metavar="DIR", help="keep the boxes there as text; a run broken off goes on from them")
    p.add_argument("--against", metavar="NAME=DIR", action="append", default=[], help="another tracker's boxes; repeat")
    p.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes, one thread each (default: 1, with --threads)"
    )
    p.add_argument("--cluster", metavar="ADDRESS", help="a Dask scheduler (tcp://HOST:8786) whose workers do it")
    p.add_argument("--sre", action="store_true", help="from twelve first boxes that are a little off, as drawn by hand")
    p.add_argument("--latency", action="store_true", help="score late answers late too, without and with prediction")
    p.add_argument("--fps", type=float, metavar="F", help="with --latency: rate of frames (default: the sequence's)")
    p.add_argument(
        "--slower", type=float, default=1.0, metavar="X", help="with --latency: as on a machine X times slower"
    )


def _add_bench_score(kinds: Commands) -> None:
    p = add_command(
        kinds, "score", "score the boxes that any tracker has left as text",
        handler="gcs.cli.bench:score",
        examples=("gcs bench score UAV123_10fps --results AutoTrack=boxes/autotrack --attributes",),
    )  # fmt: skip
    _add_dataset(p)
    p.add_argument("--results", metavar="NAME=DIR", action="append", required=True, help="a tracker's boxes; repeat")


def _add_dataset(p: Parser) -> None:
    p.add_argument("dataset", metavar="DATASET", help="folder or video; its layout is recognised")
    p.add_argument("--dataset", dest="layout", metavar="KIND", help="its layout instead: uav123, otb, got10k, ...")
    p.add_argument("--boxes", metavar="FILE", help="ground truth of one video or one folder of pictures")
    p.add_argument("--attributes", action="store_true", help="precision and success by attribute too; plots as well")
    p.add_argument("--plots", metavar="DIR", help="success, precision and centre-error figures there (PNG)")
    p.add_argument("--json", action="store_true", help="one JSON object per line, the mean last")


def _add_scenarios(commands: Commands) -> None:
    p = add_command(
        commands, "scenarios", "many closed-loop flights in simulated time, judged",
        handler="gcs.cli.scenarios:main",
        more="A table, compared with the committed figures. Exit status 1: something is worse, or unsafe.",
        examples=(
            "gcs scenarios",
            "gcs scenarios --only sine --only zigzag --all",
            "gcs scenarios --random 100 --jobs 4",
        ),
    )  # fmt: skip
    p.add_argument("--all", action="store_true", help="the whole table with three seeds; default: a quick part of it")
    p.add_argument(
        "--only", metavar="NAME", action="append", default=[], help="this scenario; with --all all its rows; repeat"
    )
    p.add_argument("--tracker", choices=("model", "real"), default="model", help="real: on painted pictures, slower")
    p.add_argument("--seeds", type=int, metavar="N", help="flights of each row (default: 1, with --all 3)")
    p.add_argument("--jobs", type=int, metavar="N", help="processes (default: one per core)")
    p.add_argument("--random", type=int, metavar="N", help="N flights drawn by lot instead of the table")
    p.add_argument("--occlusions", type=int, metavar="N", help="N flights with the target hidden for 2 s instead")
    p.add_argument("--first-seed", type=int, default=1, metavar="N", help="of --random and --occlusions")
    p.add_argument("--out", metavar="DIR", help="table and pictures go there")
    p.add_argument("--json", action="store_true", help="one JSON object per row")
    p.add_argument("--update-reference", action="store_true", help="what is flown now becomes the reference")
