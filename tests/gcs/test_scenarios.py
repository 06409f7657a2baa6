"""The closed-loop scenarios: the same again, honest about what is hidden, and a comparison that can fail."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from pathlib import Path

import pytest

from control.modes import FollowMode
from gcs.cli import entry as cli
from gcs.scenarios import reference
from gcs.scenarios.catalogue import SCENARIOS, Case, Scenario, cases, find
from gcs.scenarios.conditions import Conditions, LawKind
from gcs.scenarios.eyes import ModelConfig, ModelTracker, StageEyes
from gcs.scenarios.measure import Row
from gcs.scenarios.naive import gain_ps
from gcs.scenarios.run import fly
from gcs.scenarios.stage import Stage
from gcs.scenarios.table import Line, line_of, markdown
from sitl_mocks.vehicle import Pose
from tests.control import closed_loop
from tracker.box import Box

SHORT = replace(find("sine"), duration_s=10.0)
_LEVEL = Pose(0.0, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def spotlight() -> Row:
    return fly(SHORT, Conditions(mode=FollowMode.SPOTLIGHT))


def test_the_same_flight_again_is_the_same_to_the_last_bit(spotlight: Row) -> None:
    assert fly(SHORT, Conditions(mode=FollowMode.SPOTLIGHT)) == spotlight
    assert fly(SHORT, Conditions(mode=FollowMode.SPOTLIGHT, seed=2)).digest != spotlight.digest


def test_the_station_follows_better_than_p_on_the_raw_box(spotlight: Row) -> None:
    naive = fly(SHORT, Conditions(mode=FollowMode.SPOTLIGHT, law=LawKind.NAIVE))
    assert spotlight.unsafe == naive.unsafe == 0
    assert spotlight.bearing_rms_deg < naive.bearing_rms_deg / 2


def test_the_naive_gain_is_the_rule_for_a_raw_box() -> None:
    assert gain_ps(0.1, 20.0, 0.15) == pytest.approx(0.45 / (0.1 + 0.02 + 0.025 + 0.075))


@pytest.mark.parametrize(("name", "path"), [("sine", closed_loop.sine), ("zigzag", closed_loop.zigzag)])
def test_the_paths_are_those_the_control_side_is_tested_on(name: str, path: closed_loop.Path) -> None:
    world = find(name).build(1)
    for t_s in (0.0, 0.7, 1.9, 2.1, 5.5, 9.9, 13.3, 39.0):
        north_m, east_m, _ = world.target(t_s).position_ned_m
        assert (north_m, east_m) == pytest.approx(path(t_s), abs=0.05)


# -- the modelled tracker ---------------------------------------------------------------------------------


def _eyes(scenario: Scenario, config: ModelConfig | None = None) -> tuple[StageEyes, Stage, ModelTracker]:
    stage = Stage(scenario.build(1), covered=scenario.covered)
    eyes = StageEyes(random.Random(1), scenario.lens, stage=stage)
    return eyes, stage, ModelTracker(eyes, config or ModelConfig(dropout_rate=0.0))


def _look(eyes: StageEyes, stage: Stage, tracker: ModelTracker, t_s: float) -> bool:
    stage.begin(0.0)
    stage.step(t_s)
    return tracker.update(eyes.capture(stage.position_ned_m, _LEVEL)).visible


def test_a_covered_target_is_really_hidden_and_found_again_where_it_was() -> None:
    scenario = replace(find("walk"), covered=((1.0, 2.0),))
    eyes, stage, tracker = _eyes(scenario)
    image = eyes.capture(stage.position_ned_m, _LEVEL)
    tracker.init(image, eyes.seen_in(image)[0].box)
    seen = {step / 20: _look(eyes, stage, tracker, step / 20) for step in range(80)}
    assert all(visible for t_s, visible in seen.items() if t_s < 1.0)
    assert not any(visible for t_s, visible in seen.items() if 1.0 <= t_s < 2.0)
    assert all(visible for t_s, visible in seen.items() if t_s > 2.5)


def test_what_comes_back_far_from_where_it_is_looked_for_is_not_seen() -> None:
    scenario = replace(find("walk"), covered=((1.0, 2.0),))
    found = {}
    for place in (320.0, 40.0):
        eyes, stage, tracker = _eyes(scenario)
        image = eyes.capture(stage.position_ned_m, _LEVEL)
        tracker.init(image, eyes.seen_in(image)[0].box)
        for step in range(42):
            visible = _look(eyes, stage, tracker, step / 20)
            if not visible:
                tracker.look_at(place, 250.0)
        found[place] = visible
    assert found == {320.0: True, 40.0: False}


@pytest.mark.parametrize(("jump_rate", "is_fooled"), [(0.0, False), (1.0, True)])
def test_what_walks_between_hides_it_and_may_be_taken_for_it(jump_rate: float, is_fooled: bool) -> None:
    config = ModelConfig(dropout_rate=0.0, jump_rate=jump_rate, noise_px=0.0, drift_px=0.0)
    eyes, stage, tracker = _eyes(find("distractor"), config)
    image = eyes.capture(stage.position_ned_m, _LEVEL)
    tracker.init(image, next(o.box for o in eyes.seen_in(image) if o.name == "target"))
    hidden = fooled = 0
    while stage.t_s < 14.0:
        visible = _look(eyes, stage, tracker, stage.t_s + 0.05)
        assert eyes.newest is not None
        hidden += eyes.newest.box is None
        fooled += visible and not eyes.newest.is_hit
    assert hidden > 0
    assert (fooled > 0) is is_fooled


def test_nothing_can_be_selected_where_nothing_is() -> None:
    eyes, stage, tracker = _eyes(replace(find("walk"), covered=((0.0, 9.0),)))
    with pytest.raises(ValueError, match="nothing in the box"):
        tracker.init(eyes.capture(stage.position_ned_m, _LEVEL), Box(320.0, 240.0, 40.0, 40.0))


# -- the table and its reference --------------------------------------------------------------------------


def _line(row: Row, **changes: float) -> Line:
    return line_of(Case(SHORT, Conditions()), LawKind.STATION, [replace(row, **changes)])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("column", "worse", "same"),
    [
        ("bearing_rms_deg", 1.6, 1.04),
        ("smallest_distance_m", 0.8, 1.2),
        ("on_target_frac", 0.9, 1.0),
        ("max_gap_s", 3.0, 1.2),
    ],
)
def test_a_row_that_is_worse_by_more_than_its_noise_is_named(
    spotlight: Row, column: str, worse: float, same: float, tmp_path: Path
) -> None:
    path = tmp_path / "reference.json"
    reference.update([_line(spotlight)], path)
    known = reference.load(path)
    value = getattr(spotlight, column)
    assert reference.worse([_line(spotlight, **{column: same * value})], known) == []
    (complaint,) = reference.worse([_line(spotlight, **{column: worse * value})], known)
    assert complaint.startswith("sine follow 100ms 20fps model: ")


def test_one_unsafe_event_is_always_worse_and_never_again_found_too(spotlight: Row, tmp_path: Path) -> None:
    path = tmp_path / "reference.json"
    reference.update([_line(spotlight, reacquire_s=0.2)], path)
    known = reference.load(path)
    assert len(reference.worse([_line(spotlight, unsafe=1)], known)) == 1
    assert len(reference.worse([_line(spotlight, reacquire_s=math.inf)], known)) == 1
    assert "never" in markdown([_line(spotlight, reacquire_s=math.inf)])


def test_a_reference_that_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "reference.json"
    path.write_text('{"a": 3}')
    with pytest.raises(reference.ReferenceFileError, match=r"reference\.json"):
        reference.load(path)
    assert reference.load(tmp_path / "none.json") == {}


def test_every_row_of_the_table_has_a_name_of_its_own() -> None:
    labels = [case.label for case in cases()]
    assert len(set(labels)) == len(labels)
    assert {case.scenario.name for case in cases()} == set(SCENARIOS)


# -- the command ------------------------------------------------------------------------------------------


def test_the_command_prints_a_row_and_leaves_table_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "FILE", tmp_path / "none.json")
    status = cli.main(["scenarios", "--only", "approach", "--jobs", "1", "--json", "--out", str(tmp_path)])
    said = capsys.readouterr()
    rows = [json.loads(line) for line in said.out.splitlines()]
    assert status == 0, said.err
    assert [(row["scenario"], row["law"], row["unsafe"]) for row in rows] == [
        ("approach", "station", 0),
        ("approach", "naive", 0),
    ]
    assert "approach" in (tmp_path / "scenarios.md").read_text()
    assert len(list(tmp_path.glob("*.png"))) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--only", "nonesuch"], "is not known; there are: sine"),
        (["--only", "occlusion-2", "--tracker", "real"], "is not known"),
        (["--only", "occlusion-2s", "--tracker", "real"], "none of these can be painted"),
        (["--seeds", "0"], "--seeds 0: must be from 1"),
        (["--random", "-1"], "--random -1: must be from 1"),
    ],
)
def test_bad_arguments_get_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scenarios", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


def test_flights_by_lot_say_the_worst_and_its_seed(capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["scenarios", "--random", "2", "--occlusions", "1", "--jobs", "1"])
    said = capsys.readouterr().out
    assert "of 2 random flights flown" in said
    assert "followed again after 2 s hidden" in said
