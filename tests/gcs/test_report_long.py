"""What the report says of many changes, and of times just under a minute."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from control.engagement import State
from gcs.report.make import report_of
from gcs.report.text import text_of
from tests.gcs.report_rig import START_S, tick, ticks, write_log

KEPT = 500


def changes(count: int) -> list[tuple[float, object]]:
    """Decisions at 20 Hz, each with another state than the one before."""
    states = (State.IDLE, State.SELECTED)
    times_s = [START_S + n * 0.05 for n in range(count)]
    return [(t_s, tick(t_s, states[n % 2])) for n, t_s in enumerate(times_s)]


def test_the_last_state_that_is_kept_ends_where_the_next_began(tmp_path: Path) -> None:
    found = report_of(write_log(tmp_path / "flight", changes(KEPT + 100)))
    assert len(found.phases) == KEPT
    assert found.phases[-1].start_s == pytest.approx((KEPT - 1) * 0.05)
    assert found.phases[-1].end_s == pytest.approx(KEPT * 0.05)
    assert "100 later changes of state are not drawn in the band of states" in found.problems


def test_the_last_of_as_many_states_as_are_kept_lasts_to_the_end(tmp_path: Path) -> None:
    entries = changes(KEPT)
    last_s = START_S + 60.0
    found = report_of(write_log(tmp_path / "flight", [*entries, (last_s, tick(last_s, State.SELECTED))]))
    assert len(found.phases) == KEPT
    assert found.phases[-1].end_s == pytest.approx(60.0)
    assert not any("not drawn" in said for said in found.problems)


def test_a_time_just_under_a_minute_is_told_as_one(tmp_path: Path) -> None:
    report = report_of(write_log(tmp_path / "flight", ticks(0.0, 1.0, State.IDLE)))
    (event,) = (one for one in report.timeline if one.kind == "state")
    text = text_of(replace(report, folder="f", lasted_s=59.97, timeline=(replace(event, t_s=119.96),)))
    assert "1:00.0, vehicle unknown" in text
    assert "   2:00.0  IDLE" in text
    assert ":60" not in text
