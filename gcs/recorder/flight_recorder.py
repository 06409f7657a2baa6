"""Writes down a flight: a `Watcher` of it and its `Journal`, on threads of its own that may fail without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gcs.audit import Audit
from gcs.config import RecorderConfig
from gcs.flight_view import Sighting
from gcs.link_meters import LinkFigures
from gcs.recorder.events import FrameRecord, Received
from gcs.recorder.film import Film
from gcs.recorder.message_log import MessageLog
from gcs.tick import Tick

if TYPE_CHECKING:  # a dry run has no link, and imports none
    from gcs.framing import Message

_FIGURES_S: Final = 1.0
MESSAGES, TLOG = "messages.jsonl", "flight.tlog"


class FlightRecorder:
    """figures: asked once a second for the link's. Close it after the flight."""

    def __init__(self, folder: Path, config: RecorderConfig, film: Film | None = None) -> None:
        """folder must exist. film: written by the video source; closed with us."""
        limit = int(config.size_limit_mb * 1e6)
        self._messages = MessageLog(folder / MESSAGES, size_limit_bytes=limit) if config.messages else None
        self.film = film
        self.figures: Callable[[float], LinkFigures] | None = None
        self._figures_due_s = 0.0

    def note(self, t_s: float, event: object, frame: int | None = None) -> None:
        """Log what came from outside."""
        if self._messages is not None:
            self._messages.write(t_s, event, frame)

    def received(self, message: Message, t_s: float) -> None:
        """Log a message of the vehicle, or of another on its link."""
        self.note(t_s, Received(bytes(message.get_msgbuf())))

    def saw(self, sighting: Sighting) -> None:
        """Log the frame."""
        seen = sighting.seen
        self.note(seen.t_done_s, frame_record(sighting), seen.frame.seq)

    def ticked(self, tick: Tick) -> None:
        """Log the decision."""
        self.note(tick.t_s, tick)
        if self.figures is not None and tick.t_s >= self._figures_due_s:
            self._figures_due_s = tick.t_s + _FIGURES_S
            self.note(tick.t_s, self.figures(tick.t_s))

    def audited(self, t_s: float, audit: Audit) -> None:
        """Log the vehicle's parameters."""
        self.note(t_s, audit)

    def close(self) -> list[str]:
        """Finish the files; what went wrong with them, in one line each."""
        problems = []
        for part in (self._messages, self.film):
            if part is None:
                continue
            part.close()
            if part.problem is not None:
                problems.append(part.problem)
            elif part.dropped:
                problems.append(f"{part.dropped} records were dropped: the disk or the processor was too slow")
        return problems


def frame_record(sighting: Sighting) -> FrameRecord:
    """What the log keeps of a frame."""
    seen = sighting.seen
    frame = seen.frame
    return FrameRecord(
        frame.t_capture_s, frame.t_arrival_s, seen.t_done_s, seen.selection, seen.result,
        sighting.measurement, seen.frozen, seen.problem, frame.decode_s, seen.track_s,
        sighting.status.glass_delay, seen.repeated, sighting.predicted, sighting.t_saw_s,
        seen.fingerprint, frame.packet, seen.told,
    )  # fmt: skip
