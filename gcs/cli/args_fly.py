"""Arguments of the commands that fly, or say whether one may: run, demo, sim, doctor, audit."""

from __future__ import annotations

from typing import Final

from gcs.cli.args_operator import add_operator
from gcs.cli.args_vehicle import add_vehicle
from gcs.cli.parser import Commands, Parser, add_command

_PERSONALITIES: Final = ("px4", "ardupilot")


def add(commands: Commands) -> None:
    """The commands."""
    _add_run(commands)
    _add_demo(commands)
    _add_sim(commands)
    _add_doctor(commands)
    _add_audit(commands)


def _add_run(commands: Commands) -> None:
    p = add_command(
        commands, "run", "fly: draw a box, confirm, and the vehicle follows",
        handler="gcs.launch:main",
        more="Selecting moves nothing; a separate confirmation does. Ctrl-C sends zero, then hold, then leaves.",
        examples=(
            "gcs run --video rtsp://192.168.1.10/main --config my.yaml",
            "gcs run --profile sim                  # with `gcs sim` in another terminal",
            "gcs run --profile px4-sitl             # with `make px4_sitl gz_x500_mono_cam`",
            "gcs run --headless --config my.yaml    # on a machine without a browser",
        ),
    )  # fmt: skip
    add_video(p)
    add_vehicle(p)
    p.add_argument("--autopilot", choices=("auto", *_PERSONALITIES), help="default: what its heartbeat says")
    p.add_argument("--box", metavar="x,y,w,h", help="select this at the start; moves nothing")
    p.add_argument("--out", metavar="DIR", help="folder of the recording (default: a new one in recorder.folder)")
    add_operator(p.add_argument_group("operator"))
    p.add_argument("--json", action="store_true", help="JSON lines on stdout, what is said on stderr")


def _add_demo(commands: Commands) -> None:
    p = add_command(
        commands, "demo", "watch it fly: the whole station with a mocked vehicle",
        handler="gcs.demo:main",
        more="Starts a simulator, takes off, selects, follows, lands, and judges the flight by the simulator's truth.",
        examples=(
            "gcs demo",
            "gcs demo --seconds 20 --scenario zigzag --personality ardupilot",
            "gcs demo --gimbal --no-page --json > result.json",
        ),
    )  # fmt: skip
    p.add_argument("--seconds", type=float, metavar="N", help="length of the flight (default: 60)")
    p.add_argument("--out", metavar="DIR", help="folder of the flight, in place of an earlier demo (default: out/demo)")
    p.add_argument("--scenario", metavar="NAME", help="what the target does (see `gcs sim --list`)")
    p.add_argument("--seed", type=int, metavar="N", help="of the world")
    p.add_argument("--personality", choices=_PERSONALITIES, help="which autopilot the mock plays (default: px4)")
    p.add_argument("--gimbal", action="store_true", help="the camera is on a gimbal")
    p.add_argument("--json", action="store_true", help="the result as one JSON line on stdout")
    p.add_argument("--profile", metavar="NAME", help="a ready-made configuration (see `gcs config --profiles`)")
    add_operator(p.add_argument_group("operator"))


def _add_sim(commands: Commands) -> None:
    p = add_command(
        commands, "sim", "a mocked vehicle with its camera, to try things on",
        handler="gcs.cli.sim:main",
        more=(
            "It answers on a real UDP port like PX4 or ArduCopter and shows a rendered world from where it is: arming, "
            "modes, parameters, failsafes and delays are imitated as measured. It has no sensors, estimator or motors "
            "that could fail, and no wind unless asked for: what works here may still fail in the air. Ctrl-C ends it."
        ),
        examples=(
            "gcs sim                                # then, elsewhere: gcs run --profile sim",
            "gcs sim --scenario walk --in-air",
            "gcs sim --personality ardupilot --gimbal --wind 3,0",
            "gcs sim --list",
        ),
    )  # fmt: skip
    p.add_argument("--list", action="store_true", help="show the scenarios and leave")
    p.add_argument("--scenario", metavar="NAME|FILE", default="demo", help="what the target does (default: demo)")
    p.add_argument("--personality", choices=_PERSONALITIES, default="px4", help="which autopilot (default: px4)")
    p.add_argument("--gimbal", action="store_true", help="the camera is on a gimbal")
    p.add_argument("--in-air", action="store_true", help="begin armed and hovering, instead of on the ground")
    text = "how long the target stands once the vehicle hovers (default: 15; --in-air: 45)"
    p.add_argument("--wait", type=float, metavar="S", help=text)
    p.add_argument("--factory", action="store_true", help="with the factory's parameters: an audit refuses them")
    text = "where the station listens (default: 127.0.0.1:14540)"
    p.add_argument("--mavlink", metavar="HOST:PORT", default="127.0.0.1:14540", help=text)
    p.add_argument("--video-port", type=int, metavar="N", default=8880, help="of its video (default: 8880; 0: any)")
    p.add_argument("--fps", type=float, metavar="N", default=20.0, help="pictures a second (default: 20)")
    p.add_argument("--wind", metavar="N,E", default="0,0", help="towards north and east, m/s")
    p.add_argument("--loss", type=float, metavar="SHARE", default=0.0, help="of MAVLink lost each way, 0 to 1")
    p.add_argument("--seed", type=int, metavar="N", help="of the world")
    p.add_argument("--json", action="store_true", help="addresses and, at the end, a summary as JSON lines")


def _add_doctor(commands: Commands) -> None:
    p = add_command(
        commands, "doctor", "check this machine, video and vehicle: what to fix",
        handler="gcs.cli.doctor:main",
        more=(
            "Video and vehicle are looked at where an address is given, here or in a configuration. It never arms or "
            "moves anything: the vehicle is only asked. Exit status 1: something must be fixed."
        ),
        examples=(
            "gcs doctor                             # this machine alone",
            "gcs doctor --profile px4-sitl",
            "gcs doctor --video rtsp://192.168.1.10/main --vehicle udpin://0.0.0.0:14550",
            "gcs doctor --config my.yaml --json",
        ),
    )  # fmt: skip
    add_video(p)
    add_vehicle(p)
    text = "how long to watch video and telemetry, each (default: 5)"
    p.add_argument("--seconds", type=float, metavar="S", default=5.0, help=text)
    p.add_argument("--quick", action="store_true", help="do not load and time the tracker")
    p.add_argument("--json", action="store_true", help="one JSON line per check, the verdict last")


def _add_audit(commands: Commands) -> None:
    p = add_command(
        commands, "audit", "are the vehicle's parameters safe for following?",
        handler="gcs.cli.audit:main",
        more="It prints the lines that put right what is not, and sets nothing. Exit status 1: something is unsafe.",
        examples=(
            "gcs audit --vehicle udpin://0.0.0.0:14540",
            "gcs audit --profile radio --json",
            "gcs audit --config my.yaml --backend follow-target",
        ),
    )  # fmt: skip
    add_vehicle(p)
    p.add_argument("--json", action="store_true", help="one JSON line")


def add_video(p: Parser) -> None:
    """--video."""
    p.add_argument("--video", metavar="URL", help="stream or camera:N (default: video.url of the configuration)")
