"""A small share of `make fuzz`: enough to notice that something broke, in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl_mocks.vehicle import Personality
from tests.fuzz.configs import fuzz_configs
from tests.fuzz.link import fuzz_link
from tests.fuzz.listeners import fuzz_listeners
from tests.fuzz.packets import Kind, Mutator, frame
from tests.fuzz.report import Row, table
from tests.fuzz.supervise import supervise

LINUX = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory and handles are read from /proc")


def clean(row: Row) -> Row:
    """No problem, and at work."""
    assert row.problem_count == 0, table([row])
    assert row.count > 0
    return row


@LINUX
@pytest.mark.parametrize("personality", list(Personality))
def test_damaged_packets_do_nothing_unsafe(personality: Personality, tmp_path: Path) -> None:
    assert clean(fuzz_link(5000, 7, personality, tmp_path)).count == 5000


@LINUX
def test_damaged_videos_are_read_or_refused() -> None:
    assert clean(supervise("videos", "videos", 150, 7)).count == 150


@LINUX
def test_damaged_weights_are_refused() -> None:
    assert clean(supervise("weights", "weights", 60, 7, jobs=1)).count == 60


@LINUX
def test_damaged_flights_are_read_or_refused() -> None:
    assert clean(supervise("flights", "flights", 60, 7, jobs=1)).count == 60


@LINUX
def test_configurations_are_good_or_refused_in_one_line(tmp_path: Path) -> None:
    assert clean(fuzz_configs(150, 7, tmp_path)).count >= 150


@LINUX
def test_damaged_requests_break_nothing_and_order_nothing() -> None:
    for row in fuzz_listeners(60, 7):
        assert clean(row).count == 60


def test_the_mutator_makes_every_kind_and_repeats_itself() -> None:
    mutators = [Mutator(3), Mutator(3)]
    for mutator in mutators:
        mutator.learn(frame(30, bytes(range(28)), 1, 1))
    packets = [[mutator.packet() for _ in range(6000)] for mutator in mutators]
    assert packets[0] == packets[1]
    assert all(mutators[0].made[kind] > 0 for kind in Kind)
    assert Mutator(4).packet() != packets[0][0]


def test_a_fault_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def faulty(*args: object) -> None:
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr("gcs.telemetry.Telemetry._note", faulty)
    assert any("a fault of ours" in text for text in fuzz_link(100, 7, Personality.PX4, tmp_path).problems)
