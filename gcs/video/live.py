"""Live video on a thread of its own: the newest frame wins, none is ever queued, so none is ever old."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from gcs.errors import VideoError
from gcs.video.frame import Decoded, Decoder, Frame, check_size

FIRST_BACKOFF_S = 0.25
MAX_BACKOFF_S = 5.0
CLOSE_WAIT_S = 6.0  # a blocked read gives up after OPEN_TIMEOUT_S

log = logging.getLogger(__name__)


class LiveSource:
    """A stream or camera behind the `VideoSource` protocol; the constructor waits for the first frame.

    glass_delay_s: from light on the sensor to arrival of the encoded picture, subtracted to get the capture time.
    reconnect: after the stream breaks, try again for ever with growing pauses; else the source has `ended`.
    Raises VideoError when there is no frame to begin with.
    """

    is_live = True
    frame_count: int | None = None

    def __init__(
        self,
        name: str,
        open_decoder: Callable[[], Decoder],
        *,
        glass_delay_s: float = 0.0,
        reconnect: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = name
        self._open_decoder = open_decoder
        self._glass_delay_s = glass_delay_s
        self._reconnect = reconnect
        self._clock = clock
        self._stop = threading.Event()
        self._changed = threading.Condition()
        self._slot: Frame | None = None
        self._next_seq = 0
        self._ended = False
        self.problem: str | None = None
        self.reconnects = 0
        decoder = open_decoder()
        first = self._first_of(decoder)
        self.size = (first.image_bgr.shape[1], first.image_bgr.shape[0])
        self.fps = decoder.fps
        self._publish(first)
        self._thread = threading.Thread(target=self._run, args=(decoder,), name="video", daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """No frame will ever come again; one already here can still be read."""
        with self._changed:
            return self._ended and self._slot is None

    def read(self, timeout_s: float | None = None) -> Frame | None:
        with self._changed:
            self._changed.wait_for(lambda: self._slot is not None or self._ended, timeout_s)
            frame, self._slot = self._slot, None
            return frame

    def close(self) -> None:
        self._stop.set()
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._thread.join(CLOSE_WAIT_S)

    def _first_of(self, decoder: Decoder) -> Decoded:
        try:
            first = decoder.read()
        except VideoError:
            decoder.close()
            raise
        if first is None:
            decoder.close()
            raise VideoError(f"{self.name}: opened, but no frame came")
        return first

    def _run(self, decoder: Decoder) -> None:
        current: Decoder | None = decoder
        while current is not None:
            try:
                self._pump(current)
            except VideoError as error:
                self.problem = str(error)
            finally:
                current.close()
            current = self._reopen()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _pump(self, decoder: Decoder) -> None:
        """Publish frames until the stream ends, breaks or we are closed."""
        while not self._stop.is_set():
            decoded = decoder.read()
            if decoded is None:
                return
            check_size(self.name, decoded.image_bgr.shape[1], decoded.image_bgr.shape[0])
            if (decoded.image_bgr.shape[1], decoded.image_bgr.shape[0]) != self.size:
                # The camera model and the tracker's template belong to one picture size.
                raise VideoError(f"{self.name}: the picture size changed")
            self._publish(decoded)

    def _publish(self, decoded: Decoded) -> None:
        arrival_s = self._clock() - decoded.decode_s
        frame = Frame(self._next_seq, decoded.image_bgr, arrival_s - self._glass_delay_s, arrival_s, decoded.decode_s)
        self._next_seq += 1
        with self._changed:
            self._slot = frame
            self._changed.notify_all()

    def _reopen(self) -> Decoder | None:
        """A new decoder, trying with growing pauses; None once closed or when we shall not reconnect."""
        backoff_s = FIRST_BACKOFF_S
        while self._reconnect and not self._stop.wait(backoff_s):
            try:
                decoder = self._open_decoder()
            except VideoError as error:
                self.problem = str(error)
                log.warning("video: %s; trying again", error)
                backoff_s = min(2 * backoff_s, MAX_BACKOFF_S)
                continue
            self.reconnects += 1
            return decoder
        return None
