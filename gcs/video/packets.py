"""Packets of a live stream, taken from the network as they come, on a thread of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final

from gcs.errors import VideoError
from gcs.video.decoding import begins_anew
from gcs.video.frame import SILENT_S

BEHIND_S: Final = 0.25  # what waits longer than this makes room for what is newer
MOST_PACKETS: Final = 2000
_WAIT_S: Final = SILENT_S + 0.5  # FFmpeg itself should say so first
_CLOSE_S: Final = 0.2


class PacketQueue:
    """What a stream has sent and nobody has decoded yet, each with its time of arrival (monotonic).

    Where the decoder cannot keep up, everything before the newest key frame is dropped: old pictures are worse than
    missing ones.
    """

    def __init__(self, packets: Iterator[Any], finish: Callable[[], None], name: str, codec: str = "h264") -> None:
        """finish: called on the thread, once nothing reads any more. codec: as FFmpeg names it."""
        self._packets, self._finish, self._name, self._codec = packets, finish, name, codec
        self._waiting: deque[tuple[Any, float, bool]] = deque()
        self._changed = threading.Condition()
        self._error: BaseException | None = None
        self._stop = False
        self._thread = threading.Thread(target=self._run, name="video packets", daemon=True)
        self._thread.start()

    def get(self) -> tuple[Any, float, bool]:
        """The oldest packet, when it came, and whether a decoder can begin with it; waits.

        Raises what ended the stream, VideoError where it is silent.
        """
        with self._changed:
            come = self._changed.wait_for(lambda: self._waiting or self._error or self._stop, _WAIT_S)
            if not come:
                raise VideoError(f"{self._name}: nothing came for {SILENT_S:.0f} s")
            if not self._waiting:
                raise self._error or StopIteration
            if self._is_behind():
                self._drop()
            return self._waiting.popleft()

    def holds_from_before(self, t_s: float) -> bool:
        """Something that came before then waits."""
        with self._changed:
            return bool(self._waiting) and self._waiting[0][1] < t_s

    @property
    def is_behind(self) -> bool:
        """What comes next has waited too long: the decoder is slower than the stream."""
        with self._changed:
            return self._is_behind()

    def _is_behind(self) -> bool:
        return bool(self._waiting) and time.monotonic() - self._waiting[0][1] > BEHIND_S

    def _drop(self) -> None:
        keys = [index for index, (_, _, is_key) in enumerate(self._waiting) if is_key]
        for _ in range(keys[-1] if keys else 0):
            self._waiting.popleft()

    def _run(self) -> None:
        error: BaseException = StopIteration()
        try:
            for packet in self._packets:
                if self._stop:
                    break
                self._put(packet, time.monotonic())
        except Exception as failure:  # noqa: BLE001 - the edge of the thread: told to whoever reads
            error = failure
        with self._changed:
            self._error = error
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._stop)
        self._finish()

    def _put(self, packet: Any, arrived_s: float) -> None:
        is_key = begins_anew(packet, self._codec)
        with self._changed:
            if len(self._waiting) >= MOST_PACKETS:
                self._waiting.clear()  # nothing is decoded at all any more
            self._waiting.append((packet, arrived_s, is_key))
            self._changed.notify_all()

    def close(self) -> None:
        """Nothing more is wanted. A stream that flows is closed on return, one that stalls by itself a little later."""
        with self._changed:
            self._stop = True
            self._waiting.clear()
            self._changed.notify_all()
        self._thread.join(_CLOSE_S)
