"""Arguments of `gcs weights`: import, info, export, train, calibrate, ablate."""

from __future__ import annotations

from typing import Final

from gcs.cli.parser import Commands, add_actions, add_command

_TRAIN: Final = (
    "A run goes on with --resume as often as needed, in slices of --minutes: exit status 3 says that the schedule is "
    "not done yet. Several GPUs or machines: --devices N, or torchrun (torchrun --nproc-per-node N -m gcs.cli "
    "weights train ...)."
)

_EXPORT: Final = (
    "Graphs of fixed shapes, batch 1: embed-127 and embed-287 (patch to features), compare (features to maps), and "
    "between where there is a ClimNet (two patches to the latent frame). Patches are uint8 (1, S, S, 3) BGR."
)


def add(commands: Commands) -> None:
    """The command and its actions."""
    weights = add_command(
        commands, "weights", "import, inspect, export or train the tracker's weights",
        examples=(
            "gcs weights info",
            "gcs weights import t_best.pth --out full.safetensors",
            "gcs weights train tracker/train/compact.yaml --data PACKS --out runs/mine --resume",
        ),
    )  # fmt: skip
    actions = add_actions(weights)
    _add_import(actions)
    _add_info(actions)
    _add_export(actions)
    _add_train(actions)
    _add_ablate(actions)
    _add_calibrate(actions)


def _add_import(actions: Commands) -> None:
    p = add_command(
        actions, "import", "convert a checkpoint of the authors",
        handler="gcs.cli.weights:import_weights",
        more="Nothing in it is executed.",
        examples=("gcs weights import t_best.pth --out full.safetensors",),
    )  # fmt: skip
    p.add_argument("checkpoint", metavar="FILE", help="t_best.pth, model_best.pth or alexnet-bn.pth")
    p.add_argument("--out", metavar="FILE", required=True, help="the .safetensors file to write")
    p.add_argument("--network", default="full", metavar="NAME", help="full or compact (default: full)")


def _add_info(actions: Commands) -> None:
    p = add_command(
        actions, "info", "what a weights file holds; checks it",
        handler="gcs.cli.weights:info", examples=("gcs weights info", "gcs weights info full.safetensors"),
    )  # fmt: skip
    p.add_argument("weights", nargs="?", default="compact", metavar="NAME|FILE", help="default: compact")


def _add_export(actions: Commands) -> None:
    p = add_command(
        actions, "export", "write the network for other runtimes",
        handler="gcs.cli.weights_export:export_weights", more=_EXPORT,
        examples=(
            "gcs weights export compact --to onnx --out graphs",
            "gcs weights export compact --out graphs-int8 --int8 --frames car.mp4 walk.mp4",
        ),
    )  # fmt: skip
    p.add_argument("weights", nargs="?", default="compact", metavar="NAME|FILE", help="default: compact")
    p.add_argument("--to", choices=("onnx", "openvino"), default="onnx", help="form of the graphs (default: onnx)")
    p.add_argument("--out", metavar="DIR", required=True, help="folder for the graphs and export.json")
    p.add_argument("--int8", action="store_true", help="the backbone's first layers in 8 bits, calibrated on --frames")
    text = "videos to calibrate on, each with its boxes (x,y,w,h a line) in the .txt of the same name"
    p.add_argument("--frames", nargs="+", default=[], metavar="VIDEO", help=text)
    p.add_argument("--patches", type=int, default=80, metavar="N", help="cut from those frames (default: 80)")
    text = "how ranges follow from the values seen (default: percentile)"
    p.add_argument("--calibration", choices=("minmax", "entropy", "percentile"), default="percentile", help=text)
    text = "how many of the backbone's five, from the first on, are put into 8 bits (default: 2)"
    p.add_argument("--layers", type=int, default=2, metavar="N", help=text)


def _add_train(actions: Commands) -> None:
    p = add_command(
        actions, "train", "train from packs of pictures",
        handler="gcs.cli.weights:train", more=_TRAIN,
        examples=(
            "gcs weights train tracker/train/compact.yaml --data PACKS --out runs/mine --minutes 9 --resume",
            "gcs weights train tracker/train/compact.yaml --data PACKS --probe",
        ),
    )  # fmt: skip
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


def _add_ablate(actions: Commands) -> None:
    p = add_command(
        actions, "ablate", "train and score the paper's ablations",
        handler="gcs.cli.weights:ablate",
        more=(
            "Each with the same small budget, for several seeds: table.md, table.json and chart.png in --out. A run "
            "that was broken off goes on when given again."
        ),
        examples=("gcs weights ablate tracker/train/ablation.yaml --data PACKS --eval SEQUENCES --out runs/ablation",),
    )  # fmt: skip
    p.add_argument("settings", metavar="CONFIG", help="YAML file (see tracker/train/ablation.yaml)")
    p.add_argument("--data", metavar="DIR", required=True, help="folder with the packs to train on")
    p.add_argument("--eval", metavar="DIR", dest="dataset", required=True, help="sequences to score on")
    p.add_argument("--out", metavar="DIR", required=True, help="folder for weights, scores and tables")


def _add_calibrate(actions: Commands) -> None:
    p = add_command(
        actions, "calibrate", "fit the confidence to held-out clips",
        handler="gcs.cli.weights:calibrate",
        more="As a probability that the box is right; it goes into the manifest.",
        examples=("gcs weights calibrate runs/mine/weights.safetensors --data PACKS",),
    )  # fmt: skip
    p.add_argument("weights", metavar="FILE", help="a .safetensors file with its manifest")
    p.add_argument("--data", metavar="DIR", required=True, help="folder with the packs")
    p.add_argument("--packs", nargs="+", metavar="PACK", help="default: all in the folder")
