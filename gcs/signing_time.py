"""The time in signatures: never the same twice, never back, over restarts and crashes too.

10 µs units since 2015-01-01 UTC. A file beside the key says up to where times may have been used; it is written
ahead of their use, on its own thread, so that a slow disk holds nothing up and a crash repeats nothing.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeAlias

from gcs.clock import Clock
from gcs.errors import GcsError

UNITS_PER_S: Final = 100_000
EPOCH_UNIX_S: Final = 1_420_070_400  # 2015-01-01
MARGIN: Final = 10 * UNITS_PER_S  # what a crash may skip
_LAST: Final = 1 << 47  # 48 bits would do; a sender beyond this (the year 2059) is not followed
Stream: TypeAlias = tuple[int, int, int]  # (link id, system, component)
log = logging.getLogger(__name__)


class SigningTimeError(GcsError):
    """The file of signing times cannot be read or written."""


class SigningTime:
    """Gives out timestamps and remembers the newest of each sender."""

    def __init__(self, path: Path, clock: Clock, wall_s: float | None = None) -> None:
        """Reads and reserves at once; wall_s: seconds of the Unix epoch, by default now. SigningTimeError."""
        self._path = path
        self._clock = clock
        self._opened_s = clock.now_s()
        reserved, self.streams = _read(path)
        wall = int(((time.time() if wall_s is None else wall_s) - EPOCH_UNIX_S) * UNITS_PER_S)
        self._base = max(wall, reserved, 0)
        self._newest = self._base
        self._reserved = self._written = reserved
        self._saving: threading.Thread | None = None
        self._failed = False
        try:
            self._save(self._newest + MARGIN, self.streams)
        except OSError as error:
            raise SigningTimeError(f"signing time {path}: {_reason(error).lower()}") from None

    def now(self) -> int:
        """The present moment; what is used next is later than this."""
        elapsed_s = self._clock.now_s() - self._opened_s  # not the wall clock, which may jump
        return max(self._newest, self._base + int(elapsed_s * UNITS_PER_S))

    def take(self) -> int:
        """A timestamp nobody has had: later than all before."""
        self._newest = max(self.now(), self._newest + 1)
        self._reserve()
        return self._newest

    def heard(self, stream: Stream, timestamp: int) -> None:
        """A verified timestamp of another sender: it is not behind us for long, nor are we behind it."""
        self.streams[stream] = timestamp
        if self._newest < timestamp < _LAST:
            self._newest = timestamp
            self._reserve()

    def _reserve(self) -> None:
        if self._reserved - self._newest >= MARGIN // 2 or self._saving is not None:
            return
        values = (self._newest + MARGIN, dict(self.streams))
        self._saving = threading.Thread(target=self._save_later, args=values, name="signing time", daemon=True)
        self._saving.start()

    def _save_later(self, reserved: int, streams: Mapping[Stream, int]) -> None:
        try:
            self._save(reserved, streams)
        except (OSError, SigningTimeError) as error:
            if not self._failed:
                # Flying on matters more: a time could only repeat if the clock went back as well.
                log.warning("signing time %s is not kept any more: %s", self._path, _reason(error))
            self._failed = True
            self._reserved = reserved
        self._saving = None

    def _save(self, reserved: int, streams: Mapping[Stream, int]) -> None:
        on_disk, _ = _read(self._path)
        if on_disk != self._written:  # another of our programs uses the key: never below what it has reserved
            reserved = max(reserved, on_disk)
        lines = [str(reserved), *(f"{link} {sys} {comp} {t}" for (link, sys, comp), t in sorted(streams.items()))]
        _replace(self._path, "\n".join(lines) + "\n")
        self._reserved = self._written = reserved

    def close(self) -> None:
        """Write what was really used last (blocks on the disk)."""
        saving = self._saving
        if saving is not None:
            saving.join(2.0)
            if saving.is_alive():  # the disk is stuck; what is being written is enough
                return
        try:
            self._save(self._newest, self.streams)
        except (OSError, SigningTimeError) as error:
            log.warning("signing time %s is not kept: %s", self._path, _reason(error))


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _read(path: Path) -> tuple[int, dict[Stream, int]]:
    try:
        lines = path.read_text("ascii").splitlines()
        reserved = int(lines[0])
        rows = [tuple(map(int, line.split())) for line in lines[1:]]
        streams = {(link, system, component): timestamp for link, system, component, timestamp in rows}
        if not all(0 <= timestamp < _LAST for timestamp in (reserved, *streams.values())):
            raise ValueError("out of range")
    except FileNotFoundError:
        return 0, {}
    except OSError as error:
        raise SigningTimeError(f"signing time {path}: {_reason(error).lower()}") from None
    except (ValueError, IndexError):
        raise SigningTimeError(f"signing time {path}: damaged; delete it once this computer's clock is right") from None
    return reserved, streams


def _replace(path: Path, text: str) -> None:
    beside = path.with_name(f"{path.name}.{os.getpid()}.new")
    with beside.open("w", encoding="ascii") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
