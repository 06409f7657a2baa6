"""What can happen to a disk, done to each file of a record: the file ends whole, the rest goes on, one line says so."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs.audit import judge
from gcs.config import RecorderConfig
from gcs.recorder import batch
from gcs.recorder.flight_recorder import MESSAGES, TLOG, FlightRecorder
from gcs.recorder.message_log import MessageLog, read_messages
from gcs.recorder.tlog import TlogWriter
from gcs.tick import Tick
from tests.gcs.test_message_log import Sample


def until(condition: Callable[[], bool], timeout_s: float = 15.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file may have more than 20 kB, as on a disk that is full then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_files")
def test_a_disk_that_fills_up_leaves_whole_records(tmp_path: Path) -> None:
    messages, tlog = MessageLog(tmp_path / MESSAGES), TlogWriter(tmp_path / TLOG)
    n = 0
    while messages.problem is None or tlog.problem is None:
        for _ in range(10):
            messages.write(float(n), Sample(float(n)))
            tlog.write(bytes(100), float(n))
            n += 1
        time.sleep(0.01)
    messages.close()
    tlog.close()
    assert messages.problem == f"{tmp_path / MESSAGES}: file too large"
    records = list(read_messages(tmp_path / MESSAGES))
    assert [record.n for record in records] == list(range(len(records)))
    assert (tmp_path / MESSAGES).read_bytes().endswith(b"}\n")
    assert len(records) + messages.dropped == n
    size = (tmp_path / TLOG).stat().st_size
    assert 0 < size <= 20_000
    assert size % 108 == 0
    assert size // 108 + tlog.dropped == n


def test_the_size_limit_ends_it_between_two_records(tmp_path: Path) -> None:
    log = MessageLog(tmp_path / MESSAGES, size_limit_bytes=20_000)
    while log.problem is None:
        log.write(0.0, Sample(1.0))
        time.sleep(0.001)
    log.close()
    assert log.problem == f"{tmp_path / MESSAGES}: the size limit of 20000 bytes is reached"
    assert len(list(read_messages(tmp_path / MESSAGES))) > 10


class Stuck:
    """A file on a disk that does not answer before `release`."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self.asked, self.release = threading.Event(), threading.Event()

    def __enter__(self) -> Stuck:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> int:
        self.asked.set()
        assert self.release.wait(30.0)
        return self._file.write(data)

    def fileno(self) -> int:
        return self._file.fileno()


def test_a_disk_that_stands_still_holds_up_nobody_and_loses_nothing(tmp_path: Path) -> None:
    stuck = Stuck(tmp_path / MESSAGES)
    log = MessageLog(tmp_path / MESSAGES, open_file=lambda _: stuck)
    log.write(0.0, Sample(1.0))
    assert stuck.asked.wait(10.0)
    for n in range(1, 2000):  # ten seconds of a flight, written down while it stands
        log.write(float(n), Sample(1.0))
    assert not stuck.release.is_set()
    stuck.release.set()
    log.close()
    assert (log.dropped, log.problem) == (0, None)
    assert [record.n for record in read_messages(tmp_path / MESSAGES)] == list(range(2000))


def test_a_pipe_that_nobody_reads_is_given_up_at_the_end(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / TLOG)
    tlog = TlogWriter(tmp_path / TLOG, open_file=lambda path: path.open("wb", buffering=0))
    for _ in range(100):
        tlog.write(bytes(50), 0.0)
    tlog.close(timeout_s=0.3)
    assert tlog.problem == f"{tmp_path / TLOG}: the disk does not answer"
    with contextlib.closing(os.fdopen(os.open(tmp_path / TLOG, os.O_RDONLY | os.O_NONBLOCK))):  # lets the thread go
        until(lambda: not tlog._thread.is_alive())


def test_a_folder_that_is_deleted_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "_LOOK_S", 0.1)
    folder = tmp_path / "flight"
    folder.mkdir()
    log = MessageLog(folder / MESSAGES)
    until((folder / MESSAGES).exists)
    shutil.rmtree(folder)
    until(lambda: log.problem is not None)
    assert log.problem == f"{folder / MESSAGES}: the file was deleted"
    log.close()


def test_each_part_fails_alone_and_the_operator_is_told_once(tmp_path: Path) -> None:
    (tmp_path / MESSAGES).mkdir()  # so that it cannot be opened
    said: list[str] = []
    record = FlightRecorder(tmp_path, RecorderConfig(), with_tlog=True, say=said.append)
    assert record.tlog is not None
    until(lambda: record.troubles() != ())
    for _ in range(3):
        record.audited(0.0, judge("PX4", {}))
        record.tell()
        record.tlog.write(b"a frame", 0.0)
    line = f"{tmp_path / MESSAGES}: is a directory"
    assert record.troubles() == (line,)
    assert record.close() == [line]
    record.tell()
    assert said == [f"record: {line}"]
    assert record.dropped == 3
    assert (tmp_path / TLOG).stat().st_size == 3 * (8 + 7)


def test_what_does_not_fit_in_the_queue_is_told(tmp_path: Path) -> None:
    stuck = Stuck(tmp_path / TLOG)
    record = FlightRecorder(tmp_path, RecorderConfig(messages=False))
    tlog: Any = TlogWriter(tmp_path / TLOG, open_file=lambda _: stuck)
    record._parts = {tmp_path / TLOG: tlog}
    for _ in range(20_200):
        tlog.write(b"x", 0.0)
    assert record.troubles() == (f"{tmp_path / TLOG}: records are missing, the disk or the processor is too slow",)
    stuck.release.set()
    record.close()


def test_follows_are_counted(tmp_path: Path) -> None:
    from unittest import mock

    record = FlightRecorder(tmp_path, RecorderConfig(messages=False))
    for held in (None, "a", "a", None, None, "b", None):
        record.ticked(mock.Mock(spec=Tick, t_s=0.0, held=held))
    assert record.follows == 2
