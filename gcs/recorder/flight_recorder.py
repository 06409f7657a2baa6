"""Writes down a flight: a `Watcher` of it and its `Journal`, on threads of its own that may fail without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from gcs.audit import Audit
from gcs.config import RecorderConfig
from gcs.flight_view import Sighting
from gcs.link_meters import LinkFigures
from gcs.recorder.events import FrameRecord, Received
from gcs.recorder.film import Film
from gcs.recorder.message_log import MessageLog
from gcs.recorder.sync import Syncer
from gcs.recorder.tlog import TlogWriter
from gcs.tick import Tick

if TYPE_CHECKING:  # a dry run has no link, and imports none
    from gcs.framing import Message

_FIGURES_S: Final = 1.0
MESSAGES, TLOG, FILM = "messages.jsonl", "flight.tlog", "film"


class _Part(Protocol):
    """A file, or some, with a writer of its own."""

    dropped: int
    problem: str | None

    def close(self) -> None: ...


class FlightRecorder:
    """figures: asked once a second for the link's. tlog: for the wire to write. Close it after the flight.

    follows: how often something was followed.
    """

    def __init__(
        self,
        folder: Path,
        config: RecorderConfig,
        film: Film | None = None,
        *,
        with_tlog: bool = False,
        say: Callable[[str], None] | None = None,
    ) -> None:
        """folder must exist. film: written by the video source; closed with us. say: a line to the operator."""
        limit = int(config.size_limit_mb * 1e6)
        self._messages = MessageLog(folder / MESSAGES, size_limit_bytes=limit) if config.messages else None
        self.tlog = TlogWriter(folder / TLOG) if with_tlog and config.tlog else None
        self.film = film
        parts: dict[str, _Part | None] = {MESSAGES: self._messages, TLOG: self.tlog, FILM: film}
        self._parts = {folder / name: part for name, part in parts.items() if part is not None}
        self._syncer = Syncer(folder)
        self._say = say
        self._said: set[str] = set()
        self.figures: Callable[[float], LinkFigures] | None = None
        self._look_due_s = 0.0
        self._following = False
        self.follows = 0

    @property
    def dropped(self) -> int:
        """Records that were not written, of all parts."""
        return sum(part.dropped for part in self._parts.values())

    def troubles(self) -> tuple[str, ...]:
        """What is wrong with the record so far, a line for each part that has failed."""
        found = []
        for path, part in self._parts.items():
            if part.problem is not None:
                found.append(part.problem)
            elif part.dropped:
                found.append(f"{path}: records are missing, the disk or the processor is too slow")
        return tuple(found)

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
        self.follows += tick.held is not None and not self._following
        self._following = tick.held is not None
        if tick.t_s >= self._look_due_s:
            self._look_due_s = tick.t_s + _FIGURES_S
            if self.figures is not None:
                self.note(tick.t_s, self.figures(tick.t_s))
            self.tell()

    def tell(self) -> None:
        """Say each trouble, once."""
        for trouble in self.troubles():
            if self._say is not None and trouble not in self._said:
                self._said.add(trouble)
                self._say(f"record: {trouble}")

    def audited(self, t_s: float, audit: Audit) -> None:
        """Log the vehicle's parameters."""
        self.note(t_s, audit)

    def close(self) -> list[str]:
        """Finish the files, within some seconds even where a disk is stuck; what went wrong, in one line each."""
        for part in self._parts.values():
            part.close()
        self._syncer.close()
        return list(self.troubles())


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
