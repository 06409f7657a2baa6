"""A flight flown again from its recorded boxes comes out to the last bit, and what differs is named."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import pytest

from gcs.config import GimbalConfig
from gcs.lockstep.eyes import LENS
from gcs.lockstep.world import Setup, camera_of
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.manifest import ManifestError, read_manifest, write_manifest
from gcs.verify.again import Again, recorded_seen
from gcs.verify.compare import Comparison, Tolerance
from gcs.verify.verify import Recorded, Start, verify
from sitl_mocks.vehicle import MockGimbal, Personality
from tests.gcs.verify_rig import record_flight


def quiet(text: str) -> None:
    """No progress is shown."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    record_flight(folder)
    write_manifest(folder, msgspec.structs.replace(read_manifest(folder), ended="2026-01-01T00:00:09Z"))
    return folder


@pytest.fixture
def copied(flown: Path, tmp_path: Path) -> Path:
    for name in (MESSAGES, "manifest.json"):
        (tmp_path / name).write_bytes((flown / name).read_bytes())
    return tmp_path


def edit(folder: Path, change: Callable[[dict], dict | None]) -> None:
    """Every line of the log through `change`; None leaves it out."""
    lines = [json.loads(line) for line in (folder / MESSAGES).read_bytes().splitlines()]
    kept = [row for row in map(change, lines) if row is not None]
    (folder / MESSAGES).write_text("".join(json.dumps(row) + "\n" for row in kept))


def test_every_decision_comes_out_to_the_last_bit(flown: Path) -> None:
    verdict = verify(flown, Start.CONTROL, quiet)
    assert verdict.exact
    assert verdict.equal
    assert verdict.first is None
    assert verdict.compared["Tick"] > 120
    assert verdict.compared["FrameRecord"] > 120
    assert verdict.problems == ()
    assert verdict.elsewhere == ()
    assert verdict.lines()[0].startswith("the same to the last bit: ")


PLAIN = Setup(0).config
LEVEL = replace(LENS, mount_pitch_rad=0.0)
ON_GIMBAL = replace(PLAIN, camera=camera_of(LEVEL), gimbal=GimbalConfig(enabled=True))


@pytest.mark.parametrize(
    "setup",
    [
        Setup(4, personality=Personality.ARDUPILOT),
        Setup(5, config=ON_GIMBAL, lens=LEVEL, gimbal=partial(MockGimbal, pitch_rad=LENS.mount_pitch_rad)),
        Setup(6, config=replace(PLAIN, camera=camera_of(LENS, None))),
    ],
    ids=["ardupilot", "gimbal", "estimated delay"],
)
def test_so_does_a_flight_of_another_kind(setup: Setup, tmp_path: Path) -> None:
    record_flight(tmp_path, setup)
    verdict = verify(tmp_path, Start.CONTROL, quiet)
    assert verdict.exact, verdict.first


def test_another_tuning_comes_out_otherwise(flown: Path) -> None:
    recorded = Recorded.open(flown)
    control = recorded.config.control
    config = replace(recorded.config, control=replace(control, follow=replace(control.follow, max_yaw_rate_rps=0.2)))
    comparison = Comparison()
    again = Again(config, recorded.size, comparison, flown=recorded.config)
    for _ in again.run(recorded.log.with_data(), recorded_seen):
        pass
    assert not comparison.is_equal
    assert comparison.first is not None
    assert comparison.first.what == "Tick"


def test_a_setpoint_that_was_changed_is_named_with_its_time_and_field(copied: Path) -> None:
    at: list[float] = []

    def faster(row: dict) -> dict:
        setpoint = row["data"].get("setpoint") if row["type"] == "Tick" else None
        if setpoint and setpoint["yaw_rate_rps"] and not at:
            at.append(row["t_s"])
            setpoint["yaw_rate_rps"] += 1e-12
        return row

    edit(copied, faster)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert not verdict.equal
    assert verdict.differing == {"Tick": 1}
    assert verdict.first is not None
    assert verdict.first.startswith(f"Tick at {at[0]:.3f} s, setpoint.yaw_rate_rps: recorded ")
    assert verdict.lines()[0].startswith("NOT THE SAME: 1 of ")


def test_a_box_that_was_changed_changes_what_follows(copied: Path) -> None:
    done: list[int] = []

    def moved(row: dict) -> dict:
        if row["type"] == "FrameRecord" and row["data"]["measurement"] and not done:
            done.append(row["frame"])
            row["data"]["result"]["box"]["cx_px"] += 0.5
        return row

    edit(copied, moved)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert verdict.first is not None
    assert verdict.first.startswith(f"frame {done[0]}, measurement.")
    assert verdict.differing["Tick"] > 10


def test_what_the_vehicle_said_is_needed(copied: Path) -> None:
    edit(copied, lambda row: None if row["type"] == "Received" else row)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert not verdict.equal
    assert any("not recorded" in problem for problem in verdict.problems)


def test_elsewhere_floats_may_differ_a_little_and_nothing_else(copied: Path) -> None:
    write_manifest(copied, msgspec.structs.replace(read_manifest(copied), software={"numpy": "0.1"}))

    def nudged(row: dict) -> dict:
        if row["type"] == "Tick" and row["data"]["target"]:
            row["data"]["target"]["azimuth_rad"] += 1e-7
        return row

    edit(copied, nudged)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert verdict.equal
    assert not verdict.exact
    assert verdict.furthest == {"target.azimuth_rad": pytest.approx(1e-7, rel=1e-3)}
    assert any(each.startswith("numpy ") for each in verdict.elsewhere)

    def turned(row: dict) -> dict:
        if row["type"] == "Tick":
            row["data"]["inputs"]["audit_ok"] = True
            row["data"]["output"]["state"] = "following"
        return row

    edit(copied, turned)
    assert not verify(copied, Start.CONTROL, quiet).equal


def test_a_flight_without_a_manifest_cannot_be_flown_again(copied: Path) -> None:
    (copied / "manifest.json").unlink()
    with pytest.raises(ManifestError, match=r"manifest\.json: no such file"):
        verify(copied, Start.CONTROL, quiet)


def test_the_tolerance_is_absolute_and_relative() -> None:
    tolerance = Tolerance(absolute=0.1, relative=0.01)
    assert tolerance.allows(100.0, 101.0)
    assert not tolerance.allows(100.0, 101.2)
    assert tolerance.allows(0.0, 0.1)
    assert not tolerance.allows(0.0, 0.11)


def test_the_configuration_of_the_manifest_is_the_flights(flown: Path) -> None:
    assert read_manifest(flown).configuration == PLAIN
