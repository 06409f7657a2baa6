"""Two faults in one flight: the second comes within half a second of the first."""

from __future__ import annotations

from dataclasses import replace

from tests.faults.script import Expect, Fault, Happened, Outcome, Phase, fly
from tests.faults.world import Setup, World

_ENDS = (Expect.RELEASED, Expect.TAKEN_OVER, Expect.ENDED, Expect.GONE, Expect.CRASHED)


def pair(first: Fault, second: Fault) -> Fault:
    """Both as one fault: safe, and still within the larger bound if both of them end a follow.

    A fault can keep another one from happening (nothing is left to break), so only one of the two has to be proved.
    """

    def inject(world: World) -> Happened:
        proofs = [first.inject(world)]
        world.loop.call_later(world.random.uniform(0.0, 0.5), lambda: proofs.append(second.inject(world)))
        return lambda: len(proofs) == 2 and any(proof() for proof in proofs)

    def prepare(setup: Setup) -> Setup:
        return second.prepare(first.prepare(setup))

    bounds = [fault.bound_s for fault in (first, second) if fault.bound_s is not None and fault.expect in _ENDS]
    both_end = len(bounds) == 2 and not (first.from_start or second.from_start)
    return replace(
        first,
        name=f"{first.name} + {second.label}",
        expect=Expect.ANY,
        inject=inject,
        prepare=prepare,
        bound_s=max(bounds) + 0.5 if both_end else None,
        watch_s=max(first.watch_s, second.watch_s),
        from_start=first.from_start or second.from_start,
    )


def fly_pair(first: Fault, second: Fault, phase: Phase, seed: int) -> Outcome:
    """One run."""
    return fly(pair(first, second), phase, seed)
