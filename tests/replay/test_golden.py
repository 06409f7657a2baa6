"""Golden flights come out as they were accepted; `make golden-update` accepts what comes out now."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.verify.compare import Tolerance
from gcs.verify.verify import Start, verify
from tests.replay.golden import COURSE, course, flights, has_film, unpack

# Decisions are the same but for what another C library makes of a sine; boxes are as near as processors let them be.
DECISIONS = Tolerance(absolute=1e-9, relative=1e-9)
BOXES = Tolerance(absolute=0.05, relative=1e-3)


def quiet(text: str) -> None:
    """No progress is shown."""


@pytest.fixture(params=flights(), ids=lambda path: path.name)
def golden(request: pytest.FixtureRequest) -> Path:
    return request.param


def test_the_same_is_decided(golden: Path, tmp_path: Path) -> None:
    verdict = verify(unpack(golden, tmp_path), Start.CONTROL, quiet, DECISIONS)
    assert verdict.equal, "\n".join([*verdict.lines(), "if that is meant: make golden-update"])
    assert verdict.compared["Tick"] > 200


@pytest.mark.parametrize("golden", [path for path in flights() if has_film(path)], ids=lambda path: path.name)
def test_the_same_is_tracked(golden: Path, tmp_path: Path) -> None:
    verdict = verify(unpack(golden, tmp_path), Start.TRACKER, quiet, BOXES)
    assert verdict.equal, "\n".join([*verdict.lines(), "if that is meant: make golden-update"])
    assert verdict.tracked > 100
    assert verdict.problems == ()


def test_its_course_is_written_down_to_be_read(golden: Path, tmp_path: Path) -> None:
    assert (golden / COURSE).read_text() == course(unpack(golden, tmp_path))


def test_there_are_some() -> None:
    assert {path.name for path in flights()} >= {"px4", "ardupilot-gimbal"}
    assert any(map(has_film, flights()))
