"""Rates and losses, counted in fixed memory."""

from __future__ import annotations

import pytest

from gcs.link_meters import LossMeter, SlidingSum


def test_loss_is_counted_by_gaps_in_the_window():
    meter = LossMeter(window_s=2.0)
    for now_s, sequence in [(0.0, 254), (0.1, 255), (0.2, 0), (0.3, 3), (0.3, 3), (0.35, 1), (0.4, 4)]:
        meter.update(now_s, sequence)
    assert meter.lost == 2
    assert meter.loss_frac(0.4) == pytest.approx(2 / 7)
    assert meter.loss_frac(2.35) == 0.0
    assert LossMeter().loss_frac(1.0) == 0.0


def test_rates_forget_what_is_older_than_the_window():
    meter = SlidingSum(window_s=2.0)
    for n in range(4000):
        meter.add(n * 0.001, 1, 100)  # 1000 a second for 4 s
    first, second = meter.per_s(3.999)
    assert first == pytest.approx(1000, rel=0.02)
    assert second == pytest.approx(100_000, rel=0.02)
    assert meter.per_s(6.1) == (0.0, 0.0)
    assert len(meter._slots) == 8
