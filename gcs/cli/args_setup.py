"""Arguments of the commands that set up: config, keys, tune, completion, and weights (in args_weights)."""

from __future__ import annotations

from gcs.cli import args_weights
from gcs.cli.args_operator import add_operator
from gcs.cli.args_vehicle import add_link
from gcs.cli.parser import Commands, Parser, add_actions, add_command


def add(commands: Commands) -> None:
    """The commands."""
    _add_config(commands)
    _add_keys(commands)
    _add_tune(commands)
    args_weights.add(commands)
    _add_completion(commands)


def _add_config(commands: Commands) -> None:
    p = add_command(
        commands, "config", "show, check or explain a configuration",
        handler="gcs.cli.config:main",
        more=(
            "Alone it prints one with every key; with a file it checks that. Later wins: defaults, --profile, the "
            "file, arguments of the command line. A KEY is a name (vehicle.url) or a part of the tree (control.follow)."
        ),
        examples=(
            "gcs config > my.yaml",
            "gcs config my.yaml",
            "gcs config --explain --profile radio my.yaml vehicle control.follow",
            "gcs config --explain --changed --profile sim --port 9000",
        ),
    )  # fmt: skip
    p.add_argument("words", nargs="*", metavar="FILE|KEY", help="the file, and keys to show with --explain")
    p.add_argument("--explain", action="store_true", help="each value with its range, meaning and where it is from")
    p.add_argument("--changed", action="store_true", help="with --explain: only what is no default")
    p.add_argument("--profiles", action="store_true", help="list the ready-made configurations; with NAME print it")
    p.add_argument("--profile", metavar="NAME", help="lay this ready-made configuration under the file")
    p.add_argument("--json", action="store_true", help="with --explain: one JSON line per value")
    group = p.add_argument_group("as if given to `gcs run`")
    group.add_argument("--video", metavar="URL", help="stream or camera:N")
    add_link(group)
    add_operator(group)


def _add_keys(commands: Commands) -> None:
    keys = add_command(
        commands, "keys", "keys for MAVLink signing, so that only you fly it",
        examples=(
            "gcs keys new",
            "gcs keys send --vehicle serial:///dev/ttyACM0:57600",
            "gcs keys show-fingerprint",
        ),
    )  # fmt: skip
    actions = add_actions(keys)
    p = add_command(
        actions, "new", "make a key; never overwrites one",
        handler="gcs.cli.keys:new", examples=("gcs keys new", "gcs keys new --passphrase mine.key"),
    )  # fmt: skip
    text = "read a passphrase instead; QGroundControl and MAVProxy make the same key of it"
    p.add_argument("--passphrase", action="store_true", help=text)
    _add_key_file(p)
    p = add_command(
        actions, "show-fingerprint", "which key a file holds, without showing it",
        handler="gcs.cli.keys:show_fingerprint", examples=("gcs keys show-fingerprint",),
    )  # fmt: skip
    _add_key_file(p)
    p = add_command(
        actions, "send", "put the key on a vehicle, in the clear: over a cable",
        handler="gcs.cli.keys:send", examples=("gcs keys send --vehicle serial:///dev/ttyACM0:57600",),
    )  # fmt: skip
    p.add_argument("--vehicle", metavar="URL", required=True, help="as for `gcs run`")
    p.add_argument("--timeout", type=float, default=15.0, metavar="S", help="how long to wait for it (default: 15)")
    _add_key_file(p)


def _add_key_file(p: Parser) -> None:
    p.add_argument("path", nargs="?", metavar="FILE", help="default: ~/.config/climrt-gcs/signing.key")


def _add_tune(commands: Commands) -> None:
    p = add_command(
        commands, "tune", "which gains suit your airframe and your video's delay",
        handler="gcs.cli.tune:main",
        more="Flown in simulated time; says what error to expect with them.",
        examples=(
            "gcs tune --delay-ms 180 --out gains.yaml",
            "gcs tune --personality ardupilot --yaw-rate 0.08,0.30",
        ),
    )  # fmt: skip
    p.add_argument("--personality", choices=("px4", "ardupilot"), default="px4", help="whose responses (default: px4)")
    p.add_argument("--velocity", metavar="DEAD,TAU", help="your vehicle's answer to a step of velocity, s: 0.20,0.48")
    p.add_argument("--yaw-rate", metavar="DEAD,TAU", help="its answer to a step of yaw rate, s: 0.05,0.45")
    p.add_argument("--delay-ms", type=float, default=100.0, metavar="MS", help="from light to box (default: 100)")
    p.add_argument("--fps", type=float, default=20.0, metavar="N", help="pictures a second (default: 20)")
    p.add_argument("--noise-px", type=float, default=2.0, metavar="PX", help="of the tracker's box (default: 2)")
    p.add_argument("--jobs", type=int, metavar="N", help="flights at a time (default: one for each core)")
    p.add_argument("--out", metavar="FILE", help="write the gains there, as configuration (YAML)")
    p.add_argument("--json", action="store_true", help="one JSON line on stdout")


def _add_completion(commands: Commands) -> None:
    p = add_command(
        commands, "completion", "let your shell complete commands, options and files",
        handler="gcs.cli.completion:main",
        more="Prints a script for your shell; put the line for it where your shell reads it at its start.",
        examples=(
            "gcs completion bash > ~/.local/share/bash-completion/completions/gcs",
            "gcs completion zsh > ~/.zfunc/_gcs     # with fpath+=~/.zfunc before compinit",
            "gcs completion tcsh > ~/.gcs.tcsh      # and `source ~/.gcs.tcsh` in ~/.tcshrc",
        ),
    )  # fmt: skip
    p.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="which shell")
