"""Asking for telemetry streams until they flow; pure."""

from __future__ import annotations

import pytest

from gcs.autopilot import Stream
from gcs.autopilot.ardupilot import ArduCopter
from gcs.autopilot.px4 import Px4
from gcs.streams import StreamKeeper

ATTITUDE, MODE = Stream(30, 50.0), Stream(436, 20.0)


def test_current_mode_only_exists_on_px4():
    assert MODE.message_id in {stream.message_id for stream in Px4().streams}
    assert MODE.message_id not in {stream.message_id for stream in ArduCopter().streams}


def test_a_stream_is_asked_for_until_it_flows_with_growing_pauses():
    keeper = StreamKeeper((ATTITUDE, MODE))
    asked_at_s = []
    for n in range(4000):
        now_s = n * 0.01
        keeper.heard(ATTITUDE.message_id, now_s)  # 100 Hz: more than wanted
        due = keeper.due(now_s)
        if n > 0:
            assert ATTITUDE not in due
        if MODE in due:
            asked_at_s.append(now_s)
    assert asked_at_s == pytest.approx([0, 1, 3, 7, 15, 23, 31, 39])
    assert keeper.missing(40.0) == [MODE]


def test_a_stream_that_stops_or_is_too_slow_is_asked_for_again():
    keeper = StreamKeeper((MODE,))
    keeper.due(0.0)
    times = [n * 0.05 for n in range(1, 200)]
    for now_s in times:
        keeper.heard(436, now_s)
    assert keeper.due(times[-1]) == []
    assert keeper.due(times[-1] + 5.0) == [MODE]
    slow = StreamKeeper((MODE,))
    slow.due(0.0)
    for now_s in range(1, 10):  # 1 Hz instead of 20
        slow.heard(436, float(now_s))
    assert slow.due(9.0) == [MODE]


def test_a_flood_does_not_fill_the_memory():
    keeper = StreamKeeper((ATTITUDE,))
    for n in range(50_000):
        keeper.heard(ATTITUDE.message_id, n * 1e-4)
    assert len(keeper._flows[ATTITUDE.message_id].arrivals) <= 200
    assert keeper.missing(5.0) == []
    assert keeper.missing(9.1) == [ATTITUDE]


def test_a_pilots_mode_change_is_seen_in_time_on_px4():
    (mode,) = [stream for stream in Px4().streams if stream.message_id == MODE.message_id]
    assert mode.rate_hz == 50.0  # so that even three lost ones leave 80 ms
