"""A recorded flight, opened: its messages, its film and what it was flown with."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from control.fence import Fence
from gcs.audit import Audit
from gcs.config import Config
from gcs.errors import GcsError
from gcs.link_meters import LinkFigures
from gcs.recorder.events import Ordered, Received, Refusals, Said
from gcs.recorder.folder import in_progress_note
from gcs.recorder.manifest import MANIFEST, Manifest, read_manifest
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, FrameRow, Message, ReplayError, TickRow
from gcs.video.frame import Image

SHOWN: Final = (FrameRow, TickRow, Audit, LinkFigures, Ordered, Said, Refusals)  # all else is for flying again
_UNFENCED: Final = ("import",)  # nobody of ours kept a fence
_LEAST_BYTES: Final = 10  # of a MAVLink frame
_HFOV_RAD: Final = math.radians(70)  # where nothing tells it


@dataclass(frozen=True, slots=True)
class Moment:
    """One message at its time; image_bgr: the picture of a frame, None where it is left out or no frame."""

    t_s: float
    frame: int | None
    message: Message
    image_bgr: Image | None = None


@dataclass(frozen=True, slots=True)
class Recorded:
    """config: the flight's, the default where it is not known. problems: in one line each.

    fence: as it was kept, None where it is not known.
    """

    log: FlightLog
    film: Film
    manifest: Manifest | None
    config: Config
    fence: Fence | None
    problems: tuple[str, ...]

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view of the pictures."""
        if self.manifest is None:
            return _HFOV_RAD
        try:
            return self.config.camera_model(*self.film.size).hfov_rad
        except GcsError:  # calibrated for pictures of another shape, which are not there
            return _HFOV_RAD

    def moments(self, places: Iterable[int] | None = None, *, pictures: bool = True) -> Iterator[Moment]:
        """What is shown of these places of the log, of all of it where none are given."""
        latest_s = -math.inf
        for t_s, number, message in self.log.read(self.log.places(*SHOWN) if places is None else places):
            latest_s = max(latest_s, t_s)  # the log is in the order of writing, which time is nearly
            image_bgr = self.film.picture_of(message) if pictures and isinstance(message, FrameRow) else None
            yield Moment(latest_s, number, message, image_bgr)


def open_recorded(folder: Path) -> Recorded:
    """Raises ReplayError where there are no messages of a flight."""
    if not folder.is_dir():
        raise ReplayError(f"{folder}: no such folder")
    log = FlightLog(folder)
    film = Film(folder, log)
    manifest, config, problems = None, Config(), in_progress_note(folder)
    problems += [film.problem] if film.problem is not None else []
    if (folder / MANIFEST).exists():
        try:
            manifest = read_manifest(folder)
            config = manifest.configuration
        except GcsError as error:
            problems.append(str(error))
    fence = None
    if manifest is not None and manifest.kind not in _UNFENCED:
        fence = _placed(config.control.limits.fence, log)
    return Recorded(log, film, manifest, config, fence, tuple(problems))


def _placed(fence: Fence, log: FlightLog) -> Fence:
    """A fence in degrees gets its place where the vehicle has told its home."""
    if not fence.polygon_deg:
        return fence
    from gcs.framing import Deframer, dialect, message_id  # for fences in degrees alone

    frames = Deframer()
    for _, _, received in log.read(log.places(Received)):
        if not isinstance(received, Received) or len(received.data) < _LEAST_BYTES:
            continue
        if message_id(received.data) != dialect.MAVLINK_MSG_ID_HOME_POSITION:
            continue
        for home in frames.datagram(received.data):
            with contextlib.suppress(ValueError):  # too far from it
                return fence.placed(home.latitude / 1e7, home.longitude / 1e7)
    return fence
