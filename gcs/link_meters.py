"""What goes over the link, counted in fixed memory however much it is: rates, loss, totals. Pure."""

from __future__ import annotations

from dataclasses import dataclass

_SLOT_S = 0.25


@dataclass(slots=True)
class WireCounters:
    """What has happened to frames on the way out, and to bytes and datagrams on the way in."""

    sent: int = 0
    setpoints_sent: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    stale: int = 0  # dropped: older than STALE_S when they could leave
    refused: int = 0  # dropped: kinds that only the gate may send, or nothing that can be sent
    unsent: int = 0  # dropped: nobody to send to, or the link is congested
    foreign_datagrams: int = 0  # ignored: not from the vehicle's address


@dataclass(frozen=True, slots=True)
class LinkFigures:
    """The link in numbers, for the record: rates over the last two seconds, totals since it was opened.

    good_frames, bad_frames: frames received, and runs of bytes that were none. refused_frames: by the signing
    policy.
    """

    received_per_s: float
    received_bytes_per_s: float
    sent_per_s: float
    sent_bytes_per_s: float
    loss_frac: float
    good_frames: int
    bad_frames: int
    refused_frames: int
    totals: WireCounters


class SlidingSum:
    """Two sums over the last window_s, kept in slots: memory does not grow with the traffic."""

    def __init__(self, window_s: float = 2.0) -> None:
        self._slots = [(-1, 0, 0)] * round(window_s / _SLOT_S)
        self._window_s = window_s

    def add(self, now_s: float, first: int, second: int) -> None:
        """Add to both sums at now_s."""
        number = int(now_s / _SLOT_S)
        held, a, b = self._slots[number % len(self._slots)]
        if held != number:
            a = b = 0
        self._slots[number % len(self._slots)] = (number, a + first, b + second)

    def totals(self, now_s: float) -> tuple[int, int]:
        """Both sums over the window that ends now."""
        oldest = int(now_s / _SLOT_S) - len(self._slots)
        recent = [(a, b) for number, a, b in self._slots if number > oldest]
        return sum(a for a, _ in recent), sum(b for _, b in recent)

    def per_s(self, now_s: float) -> tuple[float, float]:
        """Both sums divided by the window."""
        first, second = self.totals(now_s)
        return first / self._window_s, second / self._window_s


class LossMeter:
    """Lost frames by gaps in the sequence numbers of one sender, over the last window."""

    def __init__(self, window_s: float = 2.0) -> None:
        self._last: int | None = None
        self._received_missing = SlidingSum(window_s)
        self.lost = 0

    def update(self, now_s: float, sequence: int) -> None:
        """Note a frame with this sequence number (0..255)."""
        missing = 0
        if self._last is not None:
            step = (sequence - self._last) % 256
            if step == 0 or step > 128:  # a duplicate, or late: counted as lost when it was overtaken
                return
            missing = step - 1
        self._last = sequence
        self.lost += missing
        self._received_missing.add(now_s, 1, missing)

    def loss_frac(self, now_s: float) -> float:
        """Share of the window's frames that did not arrive, 0..1."""
        received, missing = self._received_missing.totals(now_s)
        return missing / (received + missing) if received else 0.0
