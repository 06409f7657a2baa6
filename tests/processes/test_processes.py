"""Each fault of a process once, alternating the autopilots; `make faults` does both, and repeats."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl_mocks.vehicle import Personality
from tests.processes.faults import FAULTS


@pytest.mark.slow
@pytest.mark.parametrize(("number", "name"), list(enumerate(FAULTS)), ids=list(FAULTS))
async def test_a_fault_of_the_process_is_contained(number: int, name: str, tmp_path: Path) -> None:
    row = await FAULTS[name](list(Personality)[number % 2], number, tmp_path)
    assert row.happened, row
    assert row.unsafe == 0, row
    assert row.measured <= row.bound, row
