"""Live video on a thread of its own: the newest frame wins, none is ever queued, so none is ever old."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from gcs.errors import VideoError
from gcs.video.frame import Decoded, Decoder, Frame, check_size
from gcs.video.tap import Tap

FIRST_BACKOFF_S = 0.25
MAX_BACKOFF_S = 2.0  # longer, and a drone that is back must wait; nobody is hurt by a try every two seconds
CLOSE_WAIT_S = 1.5  # a blocked read ends by itself after SILENT_S, and nobody need wait for it
QUIET_S = 1.0
BEHIND_S = 0.3
APART_S = 1e-6  # between two pictures, at the least

log = logging.getLogger(__name__)


class LiveSource:
    """A stream or camera behind the `VideoSource` protocol; the constructor waits for the first frame.

    glass_delay_s: from light on the sensor to arrival of the encoded picture, subtracted to get the capture time.
    reconnect: after the stream breaks, try again for ever with growing pauses; else the source has `ended`.
    Pictures of another size than the first are left out: the camera model and the tracked target belong to one size.
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
        tap: Tap | None = None,
    ) -> None:
        """tap: given the pictures of a decoder that gives it no packets."""
        self.name = name
        self._open_decoder = open_decoder
        self._glass_delay_s = glass_delay_s
        self._reconnect = reconnect
        self._clock = clock
        self._tap = tap
        self._stop = threading.Event()
        self._changed = threading.Condition()
        self._slot: Frame | None = None
        self._next_seq = 0
        self._ended = False
        self._broken = False  # no connection; `problem` says why
        self._other_size: tuple[int, int] | None = None
        self._last: Frame | None = None
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

    @property
    def trouble(self) -> str:
        """What is wrong with the video now, in one line for the operator; empty when nothing is."""
        last, other = self._last, self._other_size
        if self._stop.is_set() or last is None:
            return ""
        if self._broken:
            return f"{self.problem or f'{self.name}: the stream has ended'}" + "; trying again" * self._reconnect
        if other is not None:
            return (
                f"{self.name}: the picture is now {other[0]}x{other[1]} px, but was {self.size[0]}x{self.size[1]}: "
                "set the camera back, or start anew with this size"
            )
        silent_s = self._clock() - last.t_arrival_s - last.decode_s
        if silent_s > QUIET_S:
            return f"{self.name}: no picture for {silent_s:.0f} s"
        if last.decode_s > BEHIND_S:
            return f"{self.name}: decoding is {last.decode_s:.1f} s behind: send a smaller picture, or fewer of them"
        return ""

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
        backoff_s = FIRST_BACKOFF_S
        while current is not None:
            seq = self._next_seq
            try:
                self._pump(current)
                self.problem = None
            except VideoError as error:
                self.problem = str(error)
            finally:
                self._broken = True
                current.close()
            if self._next_seq > seq:
                backoff_s = FIRST_BACKOFF_S
            current, backoff_s = self._reopen(backoff_s)
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _pump(self, decoder: Decoder) -> None:
        """Publish frames until the stream ends, breaks or we are closed."""
        while not self._stop.is_set():
            decoded = decoder.read()
            if decoded is None:
                return
            size = (decoded.image_bgr.shape[1], decoded.image_bgr.shape[0])
            check_size(self.name, *size)
            self._broken = False
            self._other_size = None if size == self.size else size
            if size == self.size:
                self._publish(decoded)

    def _publish(self, decoded: Decoded) -> None:
        arrival_s = self._clock() - decoded.decode_s
        if self._last is not None:  # two of one packet: readings of the clock in between must not turn them round
            arrival_s = max(arrival_s, self._last.t_arrival_s + APART_S)
        packet = decoded.packet
        if packet is None and self._tap is not None:
            packet = self._tap.picture(decoded.image_bgr, arrival_s)
        capture_s = arrival_s - self._glass_delay_s
        frame = Frame(self._next_seq, decoded.image_bgr, capture_s, arrival_s, decoded.decode_s, packet)
        self._next_seq += 1
        with self._changed:
            self._slot = self._last = frame
            self._changed.notify_all()

    def _reopen(self, backoff_s: float) -> tuple[Decoder | None, float]:
        """A new decoder and the next pause, growing as long as no picture comes; None once nobody wants one."""
        while self._reconnect and not self._stop.wait(backoff_s):
            backoff_s = min(2 * backoff_s, MAX_BACKOFF_S)
            try:
                decoder = self._open_decoder()
            except VideoError as error:
                if self.problem != str(error):  # a line for each reason, not for each try
                    self.problem = str(error)
                    log.warning("video: %s; trying again", error)
                continue
            self.reconnects += 1
            return decoder, backoff_s
        return None, backoff_s
