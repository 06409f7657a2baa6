"""Following a car that a straight edge covers and uncovers while the tracker stays sure of it."""

from __future__ import annotations

import pytest

from control.engagement import State
from tests.gcs.occlusion_rig import Cover, Flight, Side, fly


@pytest.mark.parametrize("delay_s", [0.1, 0.25])
@pytest.mark.parametrize("side", list(Side))
def test_covered_while_followed(side: Side, delay_s: float) -> None:
    outcome = fly(Flight(cover=Cover(side), delay_s=delay_s))
    assert State.COASTING in {row.state for row in outcome.rows}  # it was really gone
    assert abs(outcome.peak_frac) < 0.55
    assert outcome.recovery_s < 10.0
    assert outcome.end_state is State.FOLLOWING
