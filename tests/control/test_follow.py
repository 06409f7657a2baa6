"""One tick after the other: what is handed on, and what coasting leaves."""

import itertools
import math
from dataclasses import replace

import pytest

from control.config import ControlConfig
from control.follow import FollowState, follow_request

from .follow_rig import CAMERA, CONFIG, VEHICLE, confirmed, target


def test_requests_are_shaped_and_coasting_fades_them():
    further = math.log(math.hypot(15, 5) / math.hypot(25, 5))
    far = target(log_size=-2.5 + further, azimuth_rad=0.5, elevation_rad=-math.atan2(5, 25))
    state, now = FollowState.at_rest(10.0), 10.0
    requests = []
    for n in range(40):
        now += 0.05
        factor = 1.0 if n < 30 else 0.0
        request, state = follow_request(
            confirmed(), far, VEHICLE, CAMERA, now, state, ControlConfig(), velocity_factor=factor
        )
        requests.append(request)
    speeds = [math.hypot(*r.velocity_ned_mps) for r in requests]
    assert speeds[0] < 0.02
    assert speeds[29] > 1.5
    assert speeds[39] < speeds[29] - 1.0
    assert "coasting" in requests[-1].limited_by
    assert all(abs(b - a) <= 3.5 * 0.05 + 1e-9 for a, b in itertools.pairwise(speeds))


def test_own_velocity_is_lagged_like_the_rates_it_is_added_to():
    moving = replace(VEHICLE, velocity_ned_mps=(3.0, 0.0, 0.0))
    _, state = follow_request(confirmed(), target(), moving, CAMERA, 10.05, FollowState.at_rest(10.0), ControlConfig())
    assert state.own_velocity_ned_mps == (3.0, 0.0, 0.0)
    for n in range(12):
        _, state = follow_request(confirmed(), target(), VEHICLE, CAMERA, 10.1 + n * 0.05, state, ControlConfig())
    assert state.own_velocity_ned_mps[0] == pytest.approx(3.0 * math.exp(-0.6 / CONFIG.rate_lag_s))
