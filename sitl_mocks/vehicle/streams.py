"""Which message is due when: the rates of PX4's API link, and ArduCopter's silence until asked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from sitl_mocks.vehicle.modes import Personality

HEARTBEAT, SYS_STATUS, SYSTEM_TIME, GPS_RAW_INT, ATTITUDE = 0, 1, 2, 24, 30
ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT = 31, 32, 33
VFR_HUD, ATTITUDE_TARGET, POSITION_TARGET_LOCAL_NED, TIMESYNC = 74, 83, 85, 111
ALTITUDE, BATTERY_STATUS, AUTOPILOT_VERSION, ESTIMATOR_STATUS = 141, 147, 148, 230
HOME_POSITION, EXTENDED_SYS_STATE, ODOMETRY, CURRENT_MODE = 242, 245, 331, 436

PX4_API_LINK_HZ: Mapping[int, float] = {
    HEARTBEAT: 1.0,
    ATTITUDE: 100.0,
    ATTITUDE_QUATERNION: 50.0,
    GLOBAL_POSITION_INT: 50.0,
    LOCAL_POSITION_NED: 30.0,
    ODOMETRY: 30.0,
    TIMESYNC: 10.0,
    ALTITUDE: 10.0,
    ATTITUDE_TARGET: 10.0,
    POSITION_TARGET_LOCAL_NED: 10.0,
    VFR_HUD: 10.0,
    GPS_RAW_INT: 8.0,
    SYS_STATUS: 5.0,
    EXTENDED_SYS_STATE: 5.0,
    ESTIMATOR_STATUS: 1.0,
    SYSTEM_TIME: 1.0,
    BATTERY_STATUS: 0.5,
    CURRENT_MODE: 0.5,
    HOME_POSITION: 0.5,
}
ARDUPILOT_HZ: Mapping[int, float] = {HEARTBEAT: 1.0, TIMESYNC: 0.1}


def default_rates_hz(personality: Personality) -> Mapping[int, float]:
    """Message id to Hz without any request."""
    return PX4_API_LINK_HZ if personality is Personality.PX4 else ARDUPILOT_HZ


@dataclass(slots=True)
class Streams:
    """Due times of the periodic messages. A late caller gets each message once, never a burst.

    least_interval_s: of a stream that does not come quicker, whatever it is asked for: a link that is too thin.
    """

    default_hz: Mapping[int, float]
    least_interval_s: dict[int, float] = field(default_factory=dict)
    _interval_s: dict[int, float] = field(init=False)
    _due_s: dict[int, float] = field(init=False)
    _next_s: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self._interval_s = {number: 1.0 / hz for number, hz in self.default_hz.items() if hz > 0.0}
        self._due_s = dict.fromkeys(self._interval_s, 0.0)

    def due(self, now_s: float) -> list[int]:
        """Message ids to be sent now."""
        if now_s + 1e-9 < self._next_s:
            return []
        found = [number for number, due_s in self._due_s.items() if due_s <= now_s + 1e-9]
        for number in found:
            interval_s = max(self._interval_s[number], self.least_interval_s.get(number, 0.0))
            following_s = self._due_s[number] + interval_s
            self._due_s[number] = following_s if following_s > now_s else now_s + interval_s
        self._next_s = min(self._due_s.values(), default=0.0)
        return found

    def set_interval(self, number: int, interval_us: float, now_s: float) -> None:
        """SET_MESSAGE_INTERVAL: microseconds, -1 stops, 0 brings the default rate back."""
        if interval_us == 0.0:
            hz = self.default_hz.get(number, 0.0)
            interval_us = 1e6 / hz if hz > 0.0 else -1.0
        if interval_us < 0.0:
            self._interval_s.pop(number, None)
            self._due_s.pop(number, None)
            return
        self._interval_s[number] = interval_us * 1e-6
        self._due_s[number] = self._next_s = now_s

    def interval_s(self, number: int) -> float | None:
        """The interval in force in s, None when the message is not streamed."""
        return self._interval_s.get(number)

    def numbers(self) -> Iterable[int]:
        """Ids of the messages that are streamed."""
        return self._interval_s.keys()
