"""Holding to confirm, and how much one client may say (gcs.operator.web.limits)."""

from __future__ import annotations

import pytest

from gcs.operator.web.limits import Flood, HoldToConfirm
from gcs.operator.web.protocol import ProtocolError, decode


class TestHoldToConfirm:
    @pytest.mark.parametrize("held_s", [0.9, 1.0, 4.9, 5.0])
    def test_held_long_enough_for_the_same_selection_is_meant(self, held_s):
        hold = HoldToConfirm()
        hold.begin(10.0, 3)
        assert hold.use(10.0 + held_s, 3) == ""

    @pytest.mark.parametrize(
        ("held_s", "why"), [(0.0, "0.0 s only"), (0.89, "0.9 s only"), (5.01, "let go"), (60, "let go")]
    )
    def test_too_short_or_too_long_ago_is_not(self, held_s, why):
        hold = HoldToConfirm()
        hold.begin(10.0, 3)
        assert why in hold.use(10.0 + held_s, 3)

    def test_another_selection_meanwhile_is_not_the_one_that_was_meant(self):
        hold = HoldToConfirm()
        hold.begin(10.0, 3)
        assert "another target" in hold.use(11.0, 4)

    def test_without_pressing_or_after_letting_go_nothing_is_confirmed(self):
        hold = HoldToConfirm()
        assert "hold the button" in hold.use(11.0, 3)
        hold.begin(10.0, 3)
        hold.end()
        assert "hold the button" in hold.use(11.0, 3)

    @pytest.mark.parametrize("first_s", [10.5, 11.0, 16.0])
    def test_one_hold_confirms_once_whatever_came_of_it(self, first_s):
        hold = HoldToConfirm()
        hold.begin(10.0, 3)
        hold.use(first_s, 3)
        assert "hold the button" in hold.use(11.5, 3)


class TestFlood:
    def test_a_hundred_a_second_may_go_on_for_ever(self):
        flood = Flood(0.0)
        assert not any(flood.is_over(i / 100) for i in range(10_000))

    def test_twice_that_is_stopped_within_some_seconds(self):
        flood = Flood(0.0)
        stopped = next(i for i in range(10_000) if flood.is_over(i / 200))
        assert 300 < stopped <= 700

    def test_three_hundred_at_once_are_taken_and_no_more(self):
        flood = Flood(0.0)
        assert [flood.is_over(0.0) for _ in range(301)].index(True) == 300

    def test_a_quiet_hour_saves_up_nothing(self):
        flood = Flood(0.0)
        flood.is_over(3600.0)
        assert sum(not flood.is_over(3600.0) for _ in range(1000)) == 299


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", "1", '"abort"', "{}", "[" * 8000,
        '{"do":"sing"}', '{"do":"quit"}', '{"do":null}', '{"do":"abort","more":1}', '{"do":"step"}',
        '{"do":"select","box":[1,2,3],"frame":1}', '{"do":"select","box":[1,2,3,NaN],"frame":1}',
        '{"do":"select","box":[1,2,3,Infinity],"frame":1}', '{"do":"select","box":[1,2,3,1e999],"frame":1}',
        '{"do":"select","box":[1,2,3,"4"],"frame":1}', '{"do":"select","box":[1,2,3,true],"frame":1}',
        '{"do":"select","box":[1,2,3,1e7],"frame":1}', '{"do":"select","box":[1,2,3,4],"frame":-1}',
        '{"do":"select","box":[1,2,3,4],"frame":1.5}', '{"do":"select","box":[1,2,3,4],"frame":9999999999999999}',
        '{"do":"abort","id":' + "9" * 400 + "}", '{"do":"abort","id":"1"}', '{"do":"take","force":1}',
        '{"do":"standoff","m":' + "1" * 5000 + "}", '{"do":"accept","name":"' + "x" * 41 + '"}',
        '{"do":"record","on":"yes"}',
    ],
)  # fmt: skip
def test_what_no_page_of_ours_sends_is_refused_in_one_line(text):
    with pytest.raises(ProtocolError) as refused:
        decode(text)
    assert "\n" not in str(refused.value)
