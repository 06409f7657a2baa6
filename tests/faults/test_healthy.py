"""The twin of all faults: nothing is wrong, so nothing may stop, pause or be trimmed (A1, P14)."""

from __future__ import annotations

import pytest

from sitl_mocks.vehicle import Personality
from tests.faults.healthy import fly_healthy, problems


@pytest.mark.parametrize("personality", list(Personality))
@pytest.mark.parametrize("seed", [1, 2])
def test_a_healthy_flight_is_flown_without_a_pause_a_hold_or_a_trim(personality: Personality, seed: int) -> None:
    """`make faults` flies ten minutes."""
    assert problems(fly_healthy(personality, seed, 60.0)) == []
