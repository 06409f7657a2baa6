"""Two faults in one flight: the second comes within half a second of the first."""

from __future__ import annotations

from dataclasses import replace

from gcs.lockstep.world import Setup
from tests.faults.script import Expect, Fault, Happened, Outcome, Phase, fly
from tests.faults.world import FaultWorld

_ENDS = (Expect.RELEASED, Expect.TAKEN_OVER, Expect.ENDED, Expect.GONE, Expect.CRASHED)


def pair(first: Fault, second: Fault) -> Fault:
    """Both as one fault: safe, and still within the larger bound if both of them end a follow.

    A fault can keep another one from happening (nothing is left to break), so only one of the two has to be proved.
    """

    if first.from_start != second.from_start:
        early, late = (first, second) if first.from_start else (second, first)
        return _one_before(early, late)

    def inject(world: FaultWorld) -> Happened:
        proofs = [first.inject(world)]
        world.loop.call_later(world.random.uniform(0.0, 0.5), lambda: proofs.append(second.inject(world)))
        return lambda: len(proofs) == 2 and any(proof() for proof in proofs)

    def prepare(setup: Setup) -> Setup:
        return second.prepare(first.prepare(setup))

    bounds = [fault.bound_s for fault in (first, second) if fault.bound_s is not None and fault.expect in _ENDS]
    both_end = len(bounds) == 2 and not first.from_start
    return replace(
        first,
        name=f"{first.name} + {second.label}",
        expect=Expect.ANY,
        inject=inject,
        prepare=prepare,
        bound_s=max(bounds) + 0.5 if both_end else None,
        watch_s=max(first.watch_s, second.watch_s),
    )


def _one_before(early: Fault, late: Fault) -> Fault:
    """One is there from the start, and may keep the flight from coming to the other."""
    return replace(
        late,
        name=f"{late.name} + {early.label}",
        expect=Expect.ANY,
        before=early.inject,
        inject=lambda world: late.inject(world) and (lambda: True),
        prepare=lambda setup: late.prepare(early.prepare(setup)),
        bound_s=None,
        watch_s=max(early.watch_s, late.watch_s),
    )


def fly_pair(first: Fault, second: Fault, phase: Phase, seed: int) -> Outcome:
    """One run."""
    return fly(pair(first, second), phase, seed)
