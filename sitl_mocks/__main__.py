"""`python -m sitl_mocks`: a mock vehicle and its rendered camera in one process.

Prints one JSON line when ready: {"mavlink": URL for the station, "video_url": ..., "ready": true, ...}, and runs
until SIGINT or SIGTERM (with --exit-with-stdin also the end of its stdin), then writes the wire monitor's summary
if asked to.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import math
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2

from sitl_mocks import scenario
from sitl_mocks.lens import Lens
from sitl_mocks.simulator import Simulator, SimulatorConfig
from sitl_mocks.vehicle import PREPARED, Personality


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl_mocks", description=__doc__)
    add = parser.add_argument
    add("--mavlink", type=_endpoint, default=("127.0.0.1", 14540), metavar="HOST:PORT", help="the station's UDP port")
    add("--personality", choices=[p.value for p in Personality], default=Personality.PX4.value)
    add("--scenario", default="demo", help=f"one of {', '.join(scenario.names())}, or a .json file")
    add("--seed", type=int, default=None, help="of the ground, the trees and the noise (default: the scenario's)")
    add("--video-host", default="127.0.0.1", help="address the video is served on")
    add("--video-port", type=int, default=0, help="0 picks a free one")
    add("--fps", type=_between(1, 120), default=20.0)
    add("--video-delay-ms", type=_between(0, 5000), default=100.0, help="from capture to being sent")
    add("--width", type=int, default=640)
    add("--height", type=int, default=480)
    add("--hfov-deg", type=_between(10, 149), default=70.0)
    add("--mount-pitch-deg", type=_between(-90, 90), default=-28.0, help="below zero looks down")
    add("--gimbal", action="store_true", help="the camera is on a gimbal that begins at the mount's pitch")
    add("--speed", type=_between(0, 10), default=1.0, help="how fast the scenario's clock runs")
    add("--move-after", type=_between(0, 3600), default=0.0, metavar="S", help="wait once at height")
    add("--start-in-air", action="store_true", help="begin armed and hovering at the scenario's height")
    add("--wind", type=_wind, default=(0.0, 0.0, 0.0), metavar="N,E", help="wind in m/s towards north and east")
    add("--prepared", action="store_true", help="with the parameters of a careful owner, not of the factory")
    add("--param", type=_parameter, action="append", default=[], metavar="NAME=VALUE", help="may be repeated")
    add("--signing-key", type=_key, metavar="FILE", help="the vehicle signs, and believes nothing unsigned")
    add("--loss", type=_between(0, 1), default=0.0, help="share of MAVLink datagrams lost each way")
    add("--truth", type=Path, metavar="FILE", help="write the truth of each frame as JSONL")
    add("--summary", type=Path, metavar="FILE", help="write the wire monitor's summary at the end")
    add("--confirmations", action="store_true", help="stdin says `confirm` when the operator does: else U4 counts")
    add("--exit-with-stdin", action="store_true", help="end cleanly when stdin closes, as when the parent is killed")
    return parser


def _endpoint(text: str) -> tuple[str, int]:
    host, separator, port = text.rpartition(":")
    if not separator or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT")
    return host, int(port)


def _wind(text: str) -> tuple[float, float, float]:
    try:
        north, east = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not N,E in m/s") from None
    return north, east, 0.0


def _parameter(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        return name, float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE with a number") from None


def _key(path: str) -> bytes:
    try:
        return bytes.fromhex(Path(path).read_text("ascii"))
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{path}: {error.strerror}") from None
    except ValueError:
        raise argparse.ArgumentTypeError(f"{path}: not a key in hexadecimal") from None


def _parameters(options: argparse.Namespace) -> dict[str, float]:
    prepared = PREPARED[Personality(options.personality)] if options.prepared else {}
    return {**prepared, **dict(options.param)}


def _between(low: float, high: float) -> Any:
    def number(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low} and {high}")
        return value

    return number


def _config(options: argparse.Namespace) -> SimulatorConfig:
    return SimulatorConfig(
        scenario=scenario.load(options.scenario, options.seed),
        mavlink=options.mavlink,
        personality=Personality(options.personality),
        video_host=options.video_host,
        video_port=options.video_port,
        fps=options.fps,
        video_delay_s=options.video_delay_ms / 1000,
        lens=Lens(options.width, options.height, math.radians(options.hfov_deg), math.radians(options.mount_pitch_deg)),
        speed=options.speed,
        move_after_s=options.move_after,
        start_in_air=options.start_in_air,
        seed=options.seed or 0,
        wind_ned_mps=options.wind,
        loss_frac=options.loss,
        parameters=_parameters(options),
        gimbal=options.gimbal,
        confirmations=options.confirmations,
        signing_key=options.signing_key,
        truth_file=options.truth,
        summary_file=options.summary,
    )


def _say(ready: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(ready) + "\n")
    sys.stdout.flush()


async def _run(config: SimulatorConfig, *, exit_with_stdin: bool = False) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    simulator = Simulator(config)
    async with contextlib.AsyncExitStack() as opened:
        if exit_with_stdin or config.confirmations:
            ended = stop.set if exit_with_stdin else None
            pipe, _ = await loop.connect_read_pipe(lambda: _Stdin(simulator.operator_confirms, ended), sys.stdin)
            opened.callback(pipe.close)
        await simulator.run(stop, _say)


class _Stdin(asyncio.Protocol):
    """The operator's side channel: a line `confirm` for each confirmation; its end may be told too."""

    def __init__(self, confirm: Callable[[], None], ended: Callable[[], None] | None) -> None:
        self._confirm, self._ended = confirm, ended
        self._rest = b""

    def data_received(self, data: bytes) -> None:
        *lines, self._rest = (self._rest[-64:] + data).split(b"\n")
        for line in lines:
            if line.strip() == b"confirm":
                self._confirm()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._ended is not None:
            self._ended()


def main(arguments: list[str] | None = None) -> int:
    """The command line: 0 after a clean end, 2 with one line on stderr for what cannot be done."""
    options = _parser().parse_args(arguments)
    cv2.setNumThreads(1)  # rendering is meant for one core; the rest belongs to the station
    try:
        asyncio.run(_run(_config(options), exit_with_stdin=options.exit_with_stdin))
    except (ValueError, OSError) as error:
        sys.stderr.write(f"sitl_mocks: {error}{os.linesep}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
