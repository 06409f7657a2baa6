"""CSRT and KCF of opencv-contrib-python-headless, which cannot be installed beside our OpenCV: in their own place."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.benchmark.films import Film
from gcs.benchmark.timing import BenchError, Case, Sample

_PACKAGE: Final = "opencv-contrib-python-headless"
_WORKER: Final = Path(__file__).with_name("contrib_worker.py")
_TRACKERS: Final = ("CSRT", "KCF")
_INSTALL_S: Final = 180.0
_FRAMES, _WARM = 10, 2


def environment(cache: Path, said: Callable[[str], None]) -> Path:
    """The interpreter of an environment with the same version as our OpenCV; made at the first time.

    BenchError where it cannot be made, as without a network.
    """
    wanted = [f"{_PACKAGE}=={version('opencv-python-headless')}", f"numpy=={version('numpy')}"]
    folder = cache / "contrib"
    python, stamp = folder / "bin" / "python", folder / "installed.txt"
    if stamp.is_file() and stamp.read_text() == "\n".join(wanted) and python.exists():
        return python
    said(f"installing {wanted[0]} in {folder}")
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(folder)],
        [str(python), "-m", "pip", "install", "--disable-pip-version-check", "-q", "--retries", "1", *wanted],
    ):
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_INSTALL_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise BenchError(f"{wanted[0]} cannot be installed: {error}") from error
        if done.returncode:
            reason = (done.stderr or done.stdout).strip().splitlines() or ["no reason given"]
            raise BenchError(f"{wanted[0]} cannot be installed: {reason[-1]}")
    stamp.write_text("\n".join(wanted))
    return python


class Worker:
    """The other interpreter with one film; answers one order after the other."""

    def __init__(self, python: Path, film: Film, folder: Path) -> None:
        """BenchError where it does not start."""
        file = folder / f"{film.name}-{film.size[0]}x{film.size[1]}.npz"
        np.savez(file, frames=np.stack(film.frames), box=np.array([round(v) for v in film.box.xywh]))
        self._process = subprocess.Popen(
            [str(python), str(_WORKER), str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self.opencv = str(self._line()["opencv"])

    def ask(self, **order: object) -> dict[str, Any]:
        """The answer. BenchError with the other side's reason."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(order) + "\n")
            self._process.stdin.flush()
        except OSError as error:
            raise BenchError(f"its process has ended: {error}") from error
        answer = self._line()
        if "error" in answer:
            raise BenchError(str(answer["error"]))
        return answer

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise BenchError("its process has ended without an answer")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """Ends it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


class Contributed:
    """One of its trackers, timed over there by the same clocks."""

    uneven = True

    def __init__(self, worker: Worker, tracker: str, threads: int, label: str = "") -> None:
        self.name, self.threads = f"OpenCV {tracker} (contrib){label}", threads
        self._worker, self._tracker = worker, tracker

    def turn(self) -> list[Sample]:
        """See Case."""
        answer = self._worker.ask(tracker=self._tracker, threads=self.threads, frames=_FRAMES, warm=_WARM)
        return [Sample(*pair) for pair in zip(answer["cpu_ms"], answer["wall_ms"], strict=True)]


@contextlib.contextmanager
def contributed(python: Path, film: Film, folder: Path) -> Iterator[Callable[[int], list[Case]]]:
    """Cases at so many threads, as long as the block lasts."""
    worker = Worker(python, film, folder)
    try:
        yield lambda threads: [Contributed(worker, name, threads) for name in _TRACKERS]
    finally:
        worker.close()
