"""Positions from home, whatever the local frame's origin."""

from __future__ import annotations

import pytest

from gcs.home_frame import Home, HomeFrame

HOME = Home(47.0, 8.0, 400.0)
DEGREE_M = 111_194.9


def test_a_local_frame_that_begins_elsewhere_is_moved_to_home() -> None:
    frame = HomeFrame()
    assert frame.from_home((30.0, 4.0, -5.0)) == (30.0, 4.0, -5.0)
    frame.heard(HOME, (47.0, 8.0), (30.0, -12.0, -0.1), in_air=False)  # it stands at home: 30 m north of its origin
    assert frame.home is HOME
    assert frame.from_home((30.0, -12.0, -5.0)) == (0.0, 0.0, -5.0)
    assert frame.from_home((80.0, -12.0, -5.0)) == (50.0, 0.0, -5.0)


def test_home_is_told_apart_from_where_the_vehicle_is() -> None:
    frame = HomeFrame()
    frame.heard(HOME, (47.0 + 100 / DEGREE_M, 8.0), (100.0, 0.0, -20.0), in_air=True)  # connected in flight
    assert frame.from_home((100.0, 0.0, -20.0)) == pytest.approx((100.0, 0.0, -20.0), abs=0.01)


def test_in_the_air_home_stays_where_it_was() -> None:
    frame = HomeFrame()
    frame.heard(HOME, (47.0, 8.0), (0.0, 0.0, 0.0), in_air=False)
    elsewhere = Home(47.001, 8.0, 400.0)
    frame.heard(elsewhere, (47.0, 8.0), (0.0, 0.0, -20.0), in_air=True)
    assert frame.home is HOME
    assert frame.from_home((5.0, 5.0, -20.0)) == (5.0, 5.0, -20.0)
    frame.heard(elsewhere, (47.0, 8.0), (0.0, 0.0, 0.0), in_air=False)
    assert frame.home is elsewhere
    assert frame.from_home((0.0, 0.0, 0.0)) == pytest.approx((-111.2, 0.0, 0.0), abs=0.1)


def test_noise_moves_nothing() -> None:
    frame = HomeFrame()
    frame.heard(HOME, (47.0, 8.0), (1.0, 0.0, 0.0), in_air=False)
    frame.heard(HOME, (47.0, 8.0), (1.5, 1.0, 0.0), in_air=False)
    assert frame.from_home((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


def test_no_position_is_no_place() -> None:
    frame = HomeFrame()
    frame.heard(HOME, (0.0, 0.0), (0.0, 0.0, 0.0), in_air=False)
    assert frame.home is None
