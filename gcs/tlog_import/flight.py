"""The messages of an imported flight: what its vehicle said, as our own telemetry understands it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from heapq import merge
from operator import itemgetter
from typing import Final

from control.engagement import Action, Inputs, Output, State
from control.latency import UNKNOWN
from control.types import Reason
from gcs.cli.progress import shown_progress
from gcs.config import Config
from gcs.framing import Message, dialect, message_id
from gcs.recorder.events import Begun, FrameRecord, Received, Said
from gcs.recorder.message_log import MessageLog
from gcs.tick import Tick
from gcs.tlog_import.survey import Survey
from gcs.tlog_import.tlog import Tlog
from gcs.tlog_import.video import Shown
from gcs.verify.outside import RecordedClock, link_again

TICK_S: Final = 0.1  # nobody decided anything, so fewer than in a flight do
_SILENT_S: Final = 5.0  # nothing is told about a vehicle that is not heard
_PICTURE_AGE_S: Final = 1.0
_FIGURES_S: Final = 1.0


class ImportedFlight:
    """Fed in the order of time. Of the vehicle, every frame is logged as received; of other senders, none."""

    def __init__(self, log: MessageLog, config: Config, system_id: int) -> None:
        vehicle = replace(config.vehicle, system_id=system_id)
        self._log = log
        self._system_id = system_id
        self._clock = RecordedClock()
        self._link, self._end = link_again(replace(config, vehicle=vehicle), self._clock)
        self._link.wire.subscribe(self._received)
        self._tick_due_s: float | None = None
        self._figures_due_s = 0.0
        self._heard_s = 0.0
        self._shown_s: float | None = None
        self._seq = 0
        self.received = self.unknown = 0

    def run(self, tlog: Tlog, survey: Survey, start_s: float, shown: Sequence[Shown], said: str) -> None:
        """The whole log. start_s: of its first frame on the flight's clock. said: the first line of the record."""
        first_s = min(start_s, shown[0].t_s) if shown else start_s
        self._log.write(first_s, Begun())
        self._log.write(first_s, Said(said))
        frames = shown_progress(tlog, "telemetry", "frames", survey.frames)
        heard: Iterator[tuple[float, bytes | Shown]] = ((start_s + t_s, data) for t_s, data in frames)
        seen: Iterator[tuple[float, bytes | Shown]] = ((each.t_s, each) for each in shown)
        for t_s, what in merge(heard, seen, key=itemgetter(0)):
            self._ticks_until(t_s)
            self._clock.t_s = t_s
            if isinstance(what, Shown):
                self._saw(what)
            elif message_id(what) in dialect.mavlink_map:
                self._end.received(what, None)
            else:
                self.unknown += 1

    @property
    def damaged(self) -> int:
        """Frames that failed their checksum."""
        return self._link.wire.frames.bad

    def _received(self, message: Message, t_s: float) -> None:
        if message.get_srcSystem() != self._system_id:
            return
        self.received += 1
        self._heard_s = t_s
        self._log.write(t_s, Received(bytes(message.get_msgbuf())))
        if self._tick_due_s is None and self._link.wire.vehicle is not None:
            self._tick_due_s = t_s

    def _ticks_until(self, t_s: float) -> None:
        while self._tick_due_s is not None and self._tick_due_s <= t_s:
            due_s = self._tick_due_s
            self._clock.t_s = max(due_s, self._clock.t_s)
            if due_s - self._heard_s <= _SILENT_S:
                self._tick_due_s = due_s + TICK_S
                self._tick(due_s)
            else:  # however long nothing is heard
                self._tick_due_s = due_s + TICK_S * max(math.floor((t_s - due_s) / TICK_S), 1)

    def _tick(self, t_s: float) -> None:
        sees = self._shown_s is not None and t_s - self._shown_s <= _PICTURE_AGE_S
        inputs = Inputs(vehicle=self._link.telemetry.vehicle_state(), frame_t_s=self._shown_s)
        output = Output(State.IDLE if sees else State.NO_VIDEO, (), Action.NONE)
        self._log.write(t_s, Tick(t_s, inputs, output, None, None, None, Reason.NO_REQUEST))
        if t_s >= self._figures_due_s:
            self._figures_due_s = t_s + _FIGURES_S
            self._log.write(t_s, self._link.wire.figures(t_s))

    def _saw(self, shown: Shown) -> None:
        t_s = self._shown_s = shown.t_s
        record = FrameRecord(
            t_capture_s=t_s, t_arrival_s=t_s, t_done_s=t_s, selection=0, result=None, measurement=None, frozen=False,
            problem=None, decode_s=0.0, track_s=0.0, glass_delay=UNKNOWN, packet=shown.packet,
        )  # fmt: skip
        self._log.write(t_s, record, self._seq)
        self._seq += 1
