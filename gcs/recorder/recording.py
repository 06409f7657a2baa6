"""What is kept of one flight, from before its video is opened until its link is closed."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import threading
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Final

import msgspec

from gcs.clock import Clock
from gcs.config import Config
from gcs.errors import one_line
from gcs.recorder import facts
from gcs.recorder.film import Film
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.recorder.folder import FlightFolder, refused
from gcs.recorder.manifest import Manifest, write_manifest
from gcs.recorder.retention import GB, Retention
from gcs.tracking import BoxTracker
from gcs.video import VideoSource

_LITTLE_GB: Final = 1.0
_END_S: Final = 5.0  # a disk that is stuck does not hold the program


class Recording:
    """Of a flight in its folder. film: for the video source to write, None: none is wanted. record: once begun."""

    def __init__(self, folder: FlightFolder, config: Config, clock: Clock, say: Callable[[str], None]) -> None:
        self.path = folder.path
        self.film = Film(self.path) if config.recorder.video else None
        self._folder = folder
        self._config, self._clock, self._say = config, clock, say
        self.record: FlightRecorder | None = None
        self._manifest: Manifest | None = None
        self._retention: Retention | None = None

    async def begin(
        self, kind: str, source: VideoSource, vehicle: str, *, seed: int | None = None, watermark: str | None = None
    ) -> None:
        """Write the manifest and start the log, before the vehicle is waited for; arguments as of `facts.gather`.

        FolderError where that cannot be.
        """

        def write() -> tuple[Manifest, float]:
            about = {"source": source, "vehicle": vehicle, "seed": seed, "watermark": watermark}
            manifest = facts.gather(kind, self._config, self._clock, **about)  # type: ignore[arg-type]
            write_manifest(self.path, manifest)
            return manifest, shutil.disk_usage(self.path).free / GB

        try:
            self._manifest, free_gb = await asyncio.to_thread(write)
        except OSError as error:
            raise refused(self.path, error) from error
        if free_gb < _LITTLE_GB:
            self._say(f"record: only {free_gb:.1f} GB free at {self.path}")
        self.record = FlightRecorder(self.path, self._config.recorder, self.film, with_tlog=True, say=self._say)
        if kind == "run":  # a demo, which reads no configuration of the pilot's, takes nothing away
            self._make_room()

    def _make_room(self) -> None:
        keep_gb = self._config.recorder.keep_gb
        if keep_gb is None:
            return
        loop = asyncio.get_running_loop()

        def say(text: str) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._say, text)

        self._retention = Retention(Path(self._config.recorder.folder), keep_gb * GB, self.path, say)

    async def tracked_by(self, tracker: BoxTracker) -> None:
        """Note which tracker it is, once it is loaded."""
        assert self._manifest is not None
        weights, machine = facts.weights_of(tracker), self._manifest.machine | facts.pytorch_facts()
        self._manifest = msgspec.structs.replace(self._manifest, weights=weights, machine=machine)
        with contextlib.suppress(OSError):  # it stands as it was
            await asyncio.to_thread(write_manifest, self.path, self._manifest)

    async def end(self, problem: str | None = None) -> None:
        """Finish the files and say what is wrong with them; problem: why the flight ended, if not in order.

        Waits for a disk that is stuck, but not for ever.
        """
        if self._retention is not None:
            await asyncio.to_thread(self._retention.close)
        if self.record is None or self._manifest is None:
            await asyncio.to_thread(self._discard)
            return
        troubles = await asyncio.to_thread(self.record.close)
        self.record.tell()
        manifest = msgspec.structs.replace(
            self._manifest,
            ended=facts.utc(time.time()),
            follows=self.record.follows,
            dropped=self.record.dropped,
            problems=(*([] if problem is None else [problem]), *troubles),
        )
        writing = threading.Thread(target=self._finish, args=(manifest,), name="manifest", daemon=True)
        writing.start()
        await asyncio.to_thread(writing.join, _END_S)

    def _discard(self) -> None:
        if self.film is not None:
            self.film.close()
        self._folder.discard()

    def _finish(self, manifest: Manifest) -> None:
        with contextlib.suppress(OSError):  # then it is a flight broken off
            write_manifest(self.path, manifest)
        self._folder.close()


@contextlib.asynccontextmanager
async def recording(
    folder: FlightFolder, config: Config, clock: Clock, say: Callable[[str], None]
) -> AsyncIterator[Recording]:
    """A flight's, ended with the block; a folder in which nothing has begun is gone then."""
    kept, problem = Recording(folder, config, clock, say), None
    try:
        yield kept
    except Exception as error:
        problem = one_line(error)
        raise
    finally:
        await kept.end(problem)
