"""Which telemetry to ask for, and when to ask again; pure."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from gcs.autopilot import Stream

_WINDOW_S = 4.0
_ENOUGH_FRAC = 0.5  # of the rate wanted; a radio link cannot always give all of it
_FIRST_RETRY_S, _LAST_RETRY_S = 1.0, 8.0


@dataclass(slots=True)
class _Flow:
    stream: Stream
    arrivals: deque[float] = field(init=False)
    ask_t_s: float = 0.0
    retry_s: float = 0.0  # 0 = not asked yet

    def __post_init__(self) -> None:
        # No longer than it takes to see that enough arrive, however many do.
        self.arrivals = deque(maxlen=math.ceil(self._enough()))

    def _window_s(self) -> float:
        return max(_WINDOW_S, 3.0 / self.stream.rate_hz)

    def _enough(self) -> float:
        return max(1.0, _ENOUGH_FRAC * self.stream.rate_hz * self._window_s())

    def flows(self, now_s: float) -> bool:
        while self.arrivals and self.arrivals[0] < now_s - self._window_s():
            self.arrivals.popleft()
        return len(self.arrivals) >= self._enough()


class StreamKeeper:
    """Asks for every stream on connect and after a reconnect, and again with growing pauses until it flows."""

    def __init__(self, streams: tuple[Stream, ...]) -> None:
        self._flows = {stream.message_id: _Flow(stream) for stream in streams}

    def heard(self, message_id: int, t_s: float) -> None:
        """A message of the vehicle arrived."""
        flow = self._flows.get(message_id)
        if flow is not None:
            flow.arrivals.append(t_s)

    def restart(self) -> None:
        """The vehicle was away or has rebooted: what was asked is forgotten there."""
        for flow in self._flows.values():
            flow.retry_s = 0.0
            flow.arrivals.clear()

    def due(self, now_s: float) -> list[Stream]:
        """The streams to ask for now; the caller sends the requests."""
        asked = []
        for flow in self._flows.values():
            flowing = flow.flows(now_s)
            if flow.retry_s and (flowing or now_s < flow.ask_t_s + flow.retry_s):
                continue
            flow.ask_t_s = now_s
            flow.retry_s = min(2 * flow.retry_s, _LAST_RETRY_S) if flow.retry_s else _FIRST_RETRY_S
            asked.append(flow.stream)
        return asked

    def missing(self, now_s: float) -> list[Stream]:
        """The streams that do not flow."""
        return [flow.stream for flow in self._flows.values() if not flow.flows(now_s)]
