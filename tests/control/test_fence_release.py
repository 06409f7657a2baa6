"""At the fence a follow ends; being back inside does not begin it again."""

import pytest

from control.causes import Cause
from control.engagement import Action, Engagement, State
from control.types import VehicleMode
from tests.property.fence_flight import healthy_inputs

OUT = (149.5, 0.0)


def following(engagement, now_s):
    for k in range(4):
        output = engagement.update(now_s + k * 0.05, healthy_inputs(now_s + k * 0.05, (0.0, 0.0), confirm=k == 2))
    assert output.state is State.FOLLOWING
    return now_s + 0.2


@pytest.mark.parametrize("mode", [VehicleMode.HOLD, VehicleMode.EXTERNAL])
def test_the_release_at_the_fence_is_latched(mode):
    engagement = Engagement()
    now_s = following(engagement, 100.0)
    output = engagement.update(now_s, healthy_inputs(now_s, OUT))
    assert (output.state, output.action) == (State.RELEASED, Action.COMMAND_HOLD)
    assert Cause.OUTSIDE_FENCE in output.reasons
    for k in range(1, 400):  # 20 s inside again, everything green, the operator silent
        output = engagement.update(now_s + k * 0.05, healthy_inputs(now_s + k * 0.05, (0.0, 0.0), mode=mode))
        assert output.state is State.RELEASED
        assert output.action in (Action.COMMAND_HOLD, Action.SILENCE)
    now_s += 20.0
    confirmed = engagement.update(now_s, healthy_inputs(now_s, (0.0, 0.0), mode=mode, confirm=True))
    assert confirmed.state is State.RELEASED  # a confirmation alone is not enough: acknowledge first


def test_outside_nothing_begins():
    engagement = Engagement()
    for k in range(4):
        output = engagement.update(100.0 + k * 0.05, healthy_inputs(100.0 + k * 0.05, OUT, confirm=k == 2))
    assert output.state is State.SELECTED
    assert Cause.OUTSIDE_FENCE in output.reasons
