from __future__ import annotations

import io
import json
import math
import threading
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from gcs.recorder.message_log import QUEUE_LENGTH, MessageLog, read_messages


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True, slots=True)
class Sample:
    x: float
    colour: Colour = Colour.RED
    pair: tuple[float, float] = (1.0, 2.0)


def test_every_message_reads_back_bit_for_bit(tmp_path: Path) -> None:
    values = [math.pi, 0.1 + 0.2, 1e-300, -0.0, 123456789.123456789]
    with MessageLog(tmp_path / "m.jsonl", wait_when_full=True) as log:
        for i, value in enumerate(values):
            log.write(i / 3, Sample(value), frame=i)
        log.write(9.0, Sample(np.float64(0.1) * 3))
    records = list(read_messages(tmp_path / "m.jsonl"))
    assert [r.n for r in records] == list(range(6))
    assert [r.data["x"] for r in records] == [*values, float(np.float64(0.1) * 3)]
    assert [r.t_s for r in records[:3]] == [0.0, 1 / 3, 2 / 3]
    assert records[0].type == "Sample"
    assert records[0].frame == 0
    assert records[5].frame is None
    assert records[0].data["colour"] == "red"


def test_nan_is_written_as_null_and_the_line_stays_json(tmp_path: Path) -> None:
    with MessageLog(tmp_path / "m.jsonl") as log:
        log.write(0.0, Sample(math.nan))
    assert json.loads((tmp_path / "m.jsonl").read_text())["data"]["x"] is None


def test_a_line_cut_off_by_a_crash_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    with MessageLog(path) as log:
        log.write(0.0, Sample(1.0))
        log.write(0.0, Sample(2.0))
    path.write_bytes(path.read_bytes()[:-10])
    assert [r.data["x"] for r in read_messages(path)] == [1.0]


class FullDisk(io.BytesIO):
    def write(self, data: object) -> int:
        raise OSError(28, "No space left on device")


def test_a_full_disk_ends_the_log_with_one_warning_and_nothing_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log = MessageLog(tmp_path / "m.jsonl", wait_when_full=True, open_file=lambda path: FullDisk())
    for i in range(10_000):  # more than the queue holds: a dead writer must not block a waiting caller either
        log.write(float(i), Sample(1.0))
    log.close()
    assert log.problem == f"{tmp_path / 'm.jsonl'}: no space left on device"
    assert log.dropped == 10_000
    assert len(caplog.records) == 1


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    log = MessageLog(tmp_path / "none" / "m.jsonl")
    log.write(0.0, Sample(1.0))
    log.close()
    assert log.problem is not None


def test_a_message_that_is_no_json_ends_the_log_only(tmp_path: Path) -> None:
    log = MessageLog(tmp_path / "m.jsonl")
    log.write(0.0, object())
    log.close()
    assert log.problem is not None
    assert "object" in log.problem


def test_the_size_limit_holds(tmp_path: Path) -> None:
    log = MessageLog(tmp_path / "m.jsonl", size_limit_bytes=500)
    for _ in range(50):
        log.write(0.0, Sample(1.0))
    log.close()
    assert (tmp_path / "m.jsonl").stat().st_size <= 500
    assert log.problem is not None
    assert "size limit" in log.problem


def test_a_stuck_disk_never_makes_the_flight_wait(tmp_path: Path) -> None:
    release = threading.Event()
    stuck = threading.Event()

    class Stuck(io.BytesIO):
        def write(self, data: object) -> int:
            stuck.set()
            release.wait(10.0)
            return len(data)  # type: ignore[arg-type]

    log = MessageLog(tmp_path / "m.jsonl", open_file=lambda path: Stuck())
    log.write(0.0, Sample(1.0))
    assert stuck.wait(5.0)
    for _ in range(QUEUE_LENGTH + 1000):
        log.write(0.0, Sample(1.0))
    assert log.dropped == 1000
    log.close(timeout_s=0.1)
    assert log.problem == f"{tmp_path / 'm.jsonl'}: the disk does not answer"
    release.set()
