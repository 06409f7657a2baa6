"""Half of the faults of a process once, alternating the autopilots; `make faults` does all of them on both."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl_mocks.vehicle import Personality
from tests.processes.faults import Fault, blocked_loop, camera_gone, full_disk, killed, stopped

pytestmark = pytest.mark.alone  # real flights in real time want the machine to themselves

_FAULTS = (blocked_loop, stopped, killed, full_disk, camera_gone)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "fault"), tuple(enumerate(_FAULTS)), ids=[fault.__name__ for fault in _FAULTS])
async def test_a_fault_of_the_process_is_contained(number: int, fault: Fault, tmp_path: Path) -> None:
    row = await fault(list(Personality)[(number + 1) % 2], number, tmp_path)
    assert row.happened, row
    assert row.unsafe == 0, row
    assert row.measured <= row.bound, row
