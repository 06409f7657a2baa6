"""Answers to TIMESYNC: what counts as one, and when their absence means that the vehicle does not hear us."""

from __future__ import annotations

import pytest

from gcs.round_trip import RoundTrip


def asked(trip: RoundTrip, from_s: float, to_s: float, *, answers: bool = True, rtt_s: float = 0.02) -> list[bool]:
    """Ticks of 50 ms with or without answers; the verdict of each."""
    verdicts, now_s = [], from_s
    while now_s < to_s:
        stamp_ns = trip.ask(now_s)
        if stamp_ns is not None and answers:
            trip.note(12345, stamp_ns, now_s + rtt_s)
        verdicts.append(trip.is_unheard(now_s))
        now_s += 0.05
    return verdicts


def test_it_asks_ten_times_a_second() -> None:
    trip = RoundTrip()
    stamps = [trip.ask(100 + 0.05 * tick) for tick in range(40)]
    assert sum(stamp is not None for stamp in stamps) == 20
    assert len({stamp for stamp in stamps if stamp is not None}) == 20


def test_the_round_trip_is_measured() -> None:
    trip = RoundTrip()
    asked(trip, 100.0, 101.0, rtt_s=0.12)
    assert trip.rtt_s == pytest.approx(0.12)


def test_answers_that_stay_away_for_a_second_mean_that_it_does_not_hear_us() -> None:
    trip = RoundTrip()
    assert not any(asked(trip, 100.0, 102.0))
    silent = asked(trip, 102.0, 104.0, answers=False)
    assert not any(silent[:19])
    assert all(silent[24:])
    assert not any(asked(trip, 104.0, 105.0)[3:])


def test_one_that_never_answers_is_not_judged() -> None:
    assert not any(asked(RoundTrip(), 100.0, 110.0, answers=False))


def test_a_pause_of_ours_is_not_its_silence() -> None:
    trip = RoundTrip()
    asked(trip, 100.0, 101.0)
    assert not any(asked(trip, 110.0, 110.9, answers=False))
    assert asked(trip, 110.9, 111.5, answers=False)[-1]


def test_requests_and_answers_to_others_are_no_answers() -> None:
    trip = RoundTrip()
    stamp_ns = trip.ask(100.0)
    assert stamp_ns is not None
    trip.note(0, stamp_ns, 100.1)
    trip.note(12345, stamp_ns + 1, 100.1)
    assert trip.rtt_s is None
    assert not trip.is_unheard(200.0)


def test_one_way_is_half_of_the_usual_round_trip() -> None:
    trip = RoundTrip()
    asked(trip, 100.0, 101.0, rtt_s=0.12)
    assert trip.one_way_s == pytest.approx(0.06)
    asked(trip, 101.0, 101.2, rtt_s=0.5)  # two answers that waited in a stall of ours
    assert trip.one_way_s == pytest.approx(0.06)
    asked(trip, 102.0, 104.0, rtt_s=0.9)
    assert trip.one_way_s == pytest.approx(0.2)  # no more than that is believed
