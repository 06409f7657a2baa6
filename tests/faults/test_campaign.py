"""A small part of `make faults`: every fault once in one phase, on alternating autopilots, and a few pairs."""

from __future__ import annotations

import pytest

from tests.faults.campaign import all_pairs, run_job
from tests.faults.hazards import FAULTS
from tests.faults.script import Fault, Phase, fly

_PHASES = tuple(Phase)


@pytest.mark.parametrize(("number", "fault"), tuple(enumerate(FAULTS)), ids=[fault.label for fault in FAULTS])
def test_a_fault_ends_as_the_table_says(number: int, fault: Fault) -> None:
    outcome = fly(fault, _PHASES[number % len(_PHASES)], number)
    assert outcome.problems == ()


@pytest.mark.parametrize("job", all_pairs(FAULTS)[::131])
def test_two_faults_are_not_worse_than_safe(job: tuple[int, int, int, int]) -> None:
    _, outcome = run_job(job)
    assert outcome.problems == ()
