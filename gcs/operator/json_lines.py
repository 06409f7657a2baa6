"""The state of a flight for other programs: one JSON object a line, each second and at each change."""

from __future__ import annotations

import asyncio
from typing import Final

from gcs.clock import Clock
from gcs.operator.lease import Lease
from gcs.operator.station import Station
from gcs.operator.terminal_screen import Screen
from gcs.operator.web.reports import status_report

_PERIOD_S: Final = 1.0
_LOOK_S: Final = 0.1


async def write_lines(station: Station, lease: Lease, clock: Clock, out: Screen) -> None:
    """Without end; the fields are those of the page's own status (`gcs.operator.web.report_types.StatusReport`).

    out: started here, for whoever reads may stop reading; the caller ends it.
    """
    out.start()
    written, due_s = "", 0.0
    while True:
        now_s, headline = clock.now_s(), station.status().headline
        if headline != written or now_s >= due_s:
            written, due_s = headline, now_s + _PERIOD_S
            out.say(status_report(station, lease.holder(now_s), 0).encode().decode())
        await asyncio.sleep(_LOOK_S)
