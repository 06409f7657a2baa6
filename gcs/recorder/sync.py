"""What a power cut leaves of a record: its files are synced now and then, beside those who write them."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path
from typing import Final

_SYNC_S: Final = 5.0  # a power cut loses no more than this and what the disk itself holds back
_CLOSE_S: Final = 3.0


class Syncer:
    """On a thread of its own: a sync may take seconds on a card, and the death of this program must lose less."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sync", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """A last time, after the files were closed."""
        self._ending.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while not self._ending.wait(_SYNC_S):
            self._sync()
        self._sync()

    def _sync(self) -> None:
        """An error shows where the file is written."""
        for path in self._folder.glob("*"):
            with contextlib.suppress(OSError):
                if path.is_file():
                    number = os.open(path, os.O_RDONLY)
                    try:
                        os.fsync(number)
                    finally:
                        os.close(number)
