"""Keeps the audit of the vehicle's parameters up to date during a flight; never sets one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from typing import Final

from gcs.audit import Audit, Level, judge, known_name, rules_of
from gcs.autopilot.parameters import read_parameters
from gcs.backend import Backend
from gcs.clock import Clock
from gcs.telemetry import Telemetry
from gcs.wire import Wire

_LOOK_S: Final = 0.25
_AGAIN_S: Final = 10.0  # what is unsafe may have been put right by another station
NOT_READ: Final = "the vehicle's parameters have not been read yet"


class Auditor:
    """`run` reads on connect, after a vehicle was away or has rebooted, and now and then while something is unsafe.

    accepted: names the operator takes as they are. heard: told of each new result.
    """

    def __init__(
        self,
        wire: Wire,
        telemetry: Telemetry,
        clock: Clock,
        accepted: Iterable[str],
        say: Callable[[str], None],
        heard: Callable[[Audit], None] = lambda audit: None,
        backend: Backend = Backend.SETPOINTS,
    ) -> None:
        self._wire = wire
        self._telemetry = telemetry
        self._clock = clock
        self._accepted = frozenset(accepted)
        self._say = say
        self._heard = heard
        self._backend = backend
        self.values: dict[str, float] = {}
        self._reconnects: int | None = None  # as they were when reading began; None: never read
        self._last: Audit | None = None
        self.audit: Audit | None = None  # None: not read since the vehicle was away

    @property
    def ok(self) -> bool:
        """Whether a follow may start."""
        return self.audit is not None and self._is_current and self.audit.ok

    @property
    def problem(self) -> str:
        """Why not, with what to set; empty if it may."""
        return NOT_READ if self.audit is None or not self._is_current else self.audit.problem

    @property
    def _is_current(self) -> bool:
        return self._reconnects == self._telemetry.reconnects

    def accept(self, name: str) -> str:
        """Take this parameter as it is; the answer for the operator. AuditError for a name nobody asks for."""
        self._accepted |= {known_name(name)}
        if self.audit is not None:
            self._judge()
        return f"{known_name(name)} is accepted as it is"

    async def run(self) -> None:
        """Until cancelled; waits for a vehicle to be heard."""
        while self._wire.vehicle is None:
            await asyncio.sleep(_LOOK_S)
        while True:
            await self.read()
            read_t_s = self._clock.now_s()
            while self._is_current and (self.ok or self._clock.now_s() < read_t_s + _AGAIN_S):
                await asyncio.sleep(_LOOK_S)

    async def read(self) -> None:
        """Read and judge once."""
        reconnects, autopilot = self._telemetry.reconnects, self._telemetry.vehicle.autopilot.name
        names = [rule.names for rule in rules_of(autopilot, self._backend)]
        self.values = await read_parameters(self._wire, self._clock, names, self._say)
        self._reconnects = reconnects
        self._judge()

    def _judge(self) -> None:
        audit = judge(self._telemetry.vehicle.autopilot.name, self.values, self._accepted, self._backend)
        self.audit = audit
        if audit == self._last:
            return
        for finding in audit.findings:
            if finding.level is not Level.FINE:
                level = "accepted" if finding.accepted else finding.level.value
                self._say(f"{level}: {finding}: {finding.why}")
        self._last = audit
        self._heard(audit)
