"""`gcs sim`: a mocked vehicle and its rendered camera, and the line that flies it."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import shutil
import textwrap
from typing import Any, Final

import cv2

from gcs.errors import GcsError
from gcs.signals import signals
from sitl_mocks import scenario
from sitl_mocks.lens import Lens
from sitl_mocks.simulator import Simulator, SimulatorConfig
from sitl_mocks.vehicle import PREPARED, Personality

_HFOV_DEG: Final = 70.0  # as in the profiles `sim` and `sim-gimbal`, with the pitch, the delay and both addresses
_PITCH_DEG: Final = -28.0
_MAVLINK: Final = "127.0.0.1:14540"
_VIDEO_PORT: Final = 8880
_WAIT_S: Final = 15.0
_WAIT_IN_AIR_S: Final = 45.0


class SimError(GcsError):
    """The simulator cannot be had like this."""


def main(args: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    if args.list:
        _list()
        return 0
    config = _config(args)
    cv2.setNumThreads(1)  # one core for the world; the rest is the station's
    try:
        summary = asyncio.run(_run(config, args))
    except OSError as error:  # the vehicle sends from any port, so it is the video's that was taken
        reason = os.strerror(error.errno).lower() if error.errno else str(error)
        raise SimError(f"port {args.video_port} for the video: {reason}; --video-port N takes another") from None
    if args.json:
        print(json.dumps({"event": "end", **summary}))
    else:
        print(_end(summary["monitor"]))
    return 0


def _list() -> None:
    for name in scenario.names():
        print(textwrap.fill(f"{name:13s} {scenario.load(name).text}", _width(), subsequent_indent=" " * 14))


def _config(args: argparse.Namespace) -> SimulatorConfig:
    personality = Personality(args.personality)
    world = scenario.load(args.scenario, args.seed)
    if not 1 <= args.fps <= 120:
        raise SimError(f"--fps {args.fps:g}: must be from 1 to 120")
    if not 0 <= args.loss <= 1:
        raise SimError(f"--loss {args.loss:g}: must be from 0 to 1")
    if not 0 <= args.video_port <= 65535:
        raise SimError(f"--video-port {args.video_port}: must be from 0 to 65535")
    return SimulatorConfig(
        scenario=world,
        mavlink=_endpoint(args.mavlink),
        personality=personality,
        video_port=args.video_port,
        fps=args.fps,
        lens=Lens(hfov_rad=math.radians(_HFOV_DEG), mount_pitch_rad=math.radians(_PITCH_DEG)),
        move_after_s=_wait_s(args),
        start_in_air=args.in_air,
        seed=args.seed or 0,
        wind_ned_mps=_wind(args.wind),
        loss_frac=args.loss,
        parameters={} if args.factory else PREPARED[personality],
        gimbal=args.gimbal,
    )


def _wait_s(args: argparse.Namespace) -> float:
    """Long enough to open the page and draw a box."""
    wait_s: float = args.wait if args.wait is not None else _WAIT_IN_AIR_S if args.in_air else _WAIT_S
    if not 0 <= wait_s <= 3600:
        raise SimError(f"--wait {wait_s:g}: must be from 0 to 3600")
    return wait_s


def _endpoint(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise SimError(f"--mavlink {text}: must be HOST:PORT, where the station listens")
    return host, int(port)


def _wind(text: str) -> tuple[float, float, float]:
    try:
        north, east = (float(part) for part in text.split(","))
    except ValueError:
        north = east = math.nan
    if not (math.isfinite(north) and math.isfinite(east)):
        raise SimError(f"--wind {text}: must be N,E in m/s, as 3,0")
    return north, east, 0.0


async def _run(config: SimulatorConfig, args: argparse.Namespace) -> dict[str, Any]:
    """Until a signal; the summary."""
    stop, simulator = asyncio.Event(), Simulator(config)

    def ready(said: dict[str, Any]) -> None:
        if args.json:
            print(json.dumps({"event": "ready", "run": run_line(said, args), **said}), flush=True)
        else:
            print(_begin(said, config, args), flush=True)

    with signals(stop.set):
        await simulator.run(stop, ready)
    return simulator.summary()


def run_line(said: dict[str, Any], args: argparse.Namespace) -> str:
    """The station's command line for this vehicle; said: what the simulator tells of itself."""
    words = ["gcs run --profile", "sim-gimbal" if args.gimbal else "sim"]
    if args.mavlink != _MAVLINK:
        words.append(f"--vehicle {said['mavlink']}")
    if args.video_port != _VIDEO_PORT:
        words.append(f"--video {said['video_url']}")
    return " ".join(words)


def _width() -> int:
    return min(shutil.get_terminal_size().columns, 100)


def _begin(said: dict[str, Any], config: SimulatorConfig, args: argparse.Namespace) -> str:
    kind = "a PX4" if config.personality is Personality.PX4 else "an ArduCopter"
    place = f"hovering at {config.scenario.height_m:g} m" if config.start_in_air else "on the ground"
    camera = "a camera on a gimbal" if config.gimbal else "a fixed camera"
    up = "" if config.start_in_air else f"Take off there (to {config.scenario.height_m:g} m). "
    wait = (
        f"{up}The target stands for {config.move_after_s:g} s once the vehicle hovers: draw your box. Ctrl-C ends it."
    )
    return "\n".join(
        (
            f"Mocked: {kind} {place}, with {camera}. Nothing here is real.",
            textwrap.fill(f"Scenario {config.scenario.name}: {config.scenario.text}", _width(), subsequent_indent="  "),
            f"MAVLink goes to {said['mavlink'].removeprefix('udpin://')}, the video is at {said['video_url']}",
            "",
            "In another terminal:",
            f"  {run_line(said, args)}",
            "",
            textwrap.fill(wait, _width()),
        )
    )


def _end(monitor: dict[str, Any]) -> str:
    """What the judge on the wire has seen."""
    if not monitor["setpoints"]:
        return "No setpoint came."
    lines = [f"The vehicle was sent {monitor['setpoints']} setpoints, {monitor['moving_setpoints']} of them moving."]
    if monitor["unsafe"]:
        lines.append(f"UNSAFE {monitor['unsafe']} times, by the judge on its wire:")
        lines += [f"  {reason['rule']}: {reason['text']}" for reason in monitor["reasons"]]
    else:
        lines.append("None of them was unsafe, by the judge on its wire.")
    return "\n".join(lines)
