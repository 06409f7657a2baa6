"""A recorded flight, opened: its messages, its film and what it was flown with."""

from __future__ import annotations

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
from gcs.recorder.events import Ordered, Refusals, Said
from gcs.recorder.manifest import MANIFEST, Manifest, read_manifest
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, FrameRow, Message, ReplayError, TickRow
from gcs.video.frame import Image

SHOWN: Final = (FrameRow, TickRow, Audit, LinkFigures, Ordered, Said, Refusals)  # all else is for flying again
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
    """config: the flight's, the default where it is not known. problems: in one line each."""

    log: FlightLog
    film: Film
    manifest: Manifest | None
    config: Config
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

    @property
    def fence(self) -> Fence | None:
        """None where it is not known."""
        return self.config.control.limits.fence if self.manifest is not None else None

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
    manifest, config, problems = None, Config(), [film.problem] if film.problem is not None else []
    if (folder / MANIFEST).exists():
        try:
            manifest = read_manifest(folder)
            config = manifest.configuration
        except GcsError as error:
            problems.append(str(error))
    return Recorded(log, film, manifest, config, tuple(problems))
