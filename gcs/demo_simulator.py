"""The simulator as a child process: started, waited for, always reaped."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import signal
import socket
import sys
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gcs.config import CameraConfig
from gcs.demo_report import TruthRow, nearest, parse_truth
from gcs.errors import GcsError

TRUTH, SUMMARY, LOG = "truth.jsonl", "simulator.json", "simulator.log"
_READY_S: Final = 30.0
_END_S: Final = 5.0
_TAIL_BYTES: Final = 16_384


class SimulatorError(GcsError):
    """The simulator did not start, or ended before it should."""


@dataclass(frozen=True, slots=True)
class Simulator:
    """A running simulator; url: where the station listens for its vehicle."""

    vehicle_url: str
    video_url: str
    height_m: float
    camera: CameraConfig
    gimbal: bool
    folder: Path
    to_judge: asyncio.StreamWriter

    def operator_confirms(self) -> None:
        """Tell the judge on the wire, past the station, that a person is pressing the button now."""
        if not self.to_judge.is_closing():
            self.to_judge.write(b"confirm\n")

    def truth_at(self, t_s: float) -> TruthRow | None:
        """The true state at a frame taken lately at t_s."""
        with (self.folder / TRUTH).open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - _TAIL_BYTES))
            lines = file.read().splitlines(keepends=True)[1:]
        return nearest([parse_truth(json.loads(line)) for line in lines if line.endswith(b"\n")], t_s)

    def monitor(self) -> dict[str, Any]:
        """What its independent judge counted on the wire; there once the simulator has ended."""
        try:
            summary: dict[str, Any] = json.loads((self.folder / SUMMARY).read_text())["monitor"]
        except (OSError, ValueError, KeyError) as error:
            raise SimulatorError(f"the simulator left no summary: {error!r}") from None
        return summary


@contextlib.asynccontextmanager
async def simulator(
    folder: Path, *, scenario: str, personality: str, seed: int | None = None, extra: tuple[str, ...] = ()
) -> AsyncIterator[Simulator]:
    """Start it on free ports, with its files in folder; ended when the block is left, however it is left."""
    arguments = [
        "--mavlink", f"127.0.0.1:{_free_udp_port()}", "--video-port", "0", "--scenario", scenario,
        "--personality", personality, "--truth", str(folder / TRUTH), "--summary", str(folder / SUMMARY),
        "--exit-with-stdin", "--prepared", *([] if seed is None else ["--seed", str(seed)]), *extra,
    ]  # fmt: skip
    (folder / SUMMARY).unlink(missing_ok=True)
    with (folder / LOG).open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "sitl_mocks", *arguments,
            stdin=asyncio.subprocess.PIPE,  # the operator's confirmations; it ends when we do, even by SIGKILL
            stdout=asyncio.subprocess.PIPE, stderr=log,
            start_new_session=True,  # Ctrl-C is for the station: the vehicle must live on to be told to hold
        )  # fmt: skip
    try:
        assert process.stdin is not None
        yield _ready(await _ready_line(process, folder), folder, process.stdin)
    finally:
        await _end(process)


async def _ready_line(process: asyncio.subprocess.Process, folder: Path) -> bytes:
    assert process.stdout is not None
    try:
        line = await asyncio.wait_for(process.stdout.readline(), _READY_S)
    except TimeoutError:
        raise SimulatorError(f"the simulator was not ready within {_READY_S:g} s") from None
    if not line:
        said = (folder / LOG).read_text(errors="replace").strip().splitlines()
        raise SimulatorError(f"the simulator does not start: {said[-1] if said else 'it says nothing'}")
    return line


def _ready(line: bytes, folder: Path, to_judge: asyncio.StreamWriter) -> Simulator:
    try:
        said = json.loads(line)
        camera = said["camera"]
        lens = CameraConfig(
            hfov_deg=math.degrees(camera["hfov_rad"]),
            distortion=tuple(camera["distortion"]),
            mount_rpy_deg=(0.0, math.degrees(camera["mount_pitch_rad"]), 0.0),
            glass_delay_s=camera["delay_s"],
        )
        return Simulator(said["mavlink"], said["video_url"], said["height_m"], lens, camera["gimbal"], folder, to_judge)
    except (ValueError, KeyError, TypeError) as error:
        raise SimulatorError(f"the simulator's first line is not understood: {error!r}") from None


async def _end(process: asyncio.subprocess.Process) -> None:
    """Ask it to end and write its summary; without an answer, end it."""
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)
    try:
        await asyncio.wait_for(process.wait(), _END_S)
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
