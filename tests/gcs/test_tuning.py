"""`gcs tune`: airframes from step responses, and a sweep that finds what is better."""

from __future__ import annotations

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from gcs.cli import entry as cli
from gcs.tuning import sweep as sweeping
from gcs.tuning.airframe import AirframeError, StepResponse, airframe, measured
from sitl_mocks.dynamics import PX4, MotionCommand, Multicopter
from sitl_mocks.vehicle import Personality


@pytest.mark.parametrize(("dead_s", "tau_s"), [(0.2, 0.48), (0.5, 0.6), (0.3, 1.0)])
def test_an_airframe_answers_as_it_was_measured(dead_s: float, tau_s: float) -> None:
    frame = airframe(Personality.PX4, StepResponse(dead_s, tau_s), StepResponse(dead_s / 2, tau_s))
    velocity, yaw = measured(frame, yaw=False), measured(frame, yaw=True)
    assert velocity.dead_s + velocity.tau_s == pytest.approx(dead_s + tau_s, rel=0.05)
    assert velocity.tau_s == pytest.approx(tau_s, rel=0.05)
    assert yaw.dead_s + yaw.tau_s == pytest.approx(dead_s / 2 + tau_s, rel=0.05)


def test_the_mock_flies_so_too() -> None:
    """63 % of a step of velocity after dead time and time constant, by the vehicle of the scenarios itself."""
    body = Multicopter(airframe(Personality.PX4, StepResponse(0.4, 0.8)))
    body.motion = replace(body.motion, position_ned_m=(0.0, 0.0, -10.0), on_ground=False)
    t_s = 0.0
    while body.motion.velocity_ned_mps[0] < 0.632 * 2.0:
        body.step(0.01, MotionCommand((2.0, 0.0, 0.0)))
        t_s += 0.01
    assert t_s == pytest.approx(1.2, rel=0.06)


@pytest.mark.parametrize("text", ["", "0.2", "a,b", "0.2,0", "5,0.4", "0.2;0.4", "nan,1", "1.2.3,4"])
def test_a_response_no_vehicle_has_is_refused(text: str) -> None:
    with pytest.raises(AirframeError, match="DEAD,TAU"):
        StepResponse.parse(text, "--velocity")


def test_a_slower_airframe_is_begun_with_slower_gains() -> None:
    slow_frame = airframe(Personality.PX4, StepResponse(0.4, 1.0), StepResponse(0.1, 0.8))
    own, slow = sweeping.begin_with(PX4), sweeping.begin_with(slow_frame)
    assert slow["range_gain_ps"] < 0.6 * own["range_gain_ps"]
    assert slow["yaw_lag_s"] > 1.5 * own["yaw_lag_s"]


def test_the_sweep_keeps_what_is_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a good gain and one that hardly turns, both really flown."""
    monkeypatch.setattr(sweeping, "KNOBS", (replace(sweeping.KNOBS[0], factors=(0.05, 1.0)),))
    monkeypatch.setattr(sweeping, "PATHS", ("sine",))
    monkeypatch.setattr(sweeping, "_SHORT_S", 9.0)
    monkeypatch.setattr(sweeping, "_ways", lambda job: [(job, 0.0)])
    monkeypatch.setattr(sweeping, "_whole", sweeping._short)
    told: list[str] = []
    with ThreadPoolExecutor(1) as pool:
        tuned = sweeping.sweep(sweeping.Job(PX4), pool, told.append)
    assert "yaw_gain_ps" not in tuned.gains  # the default
    assert told[0].startswith(f"yaw_gain_ps {sweeping.begin_with(PX4)['yaw_gain_ps']:.3g}:")
    assert all(e.after.unsafe == 0 and math.isfinite(e.after.bearing_rms_deg) for e in tuned.expected)


@pytest.mark.parametrize("bad", [["--delay-ms", "900"], ["--fps", "0"], ["--velocity", "x"], ["--noise-px", "-1"]])
def test_bad_input_is_one_line(bad: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["tune", *bad]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert bad[0] in error


def test_its_json_is_one_line_that_a_configuration_can_be_made_of() -> None:
    from gcs.cli.tune import _as_json, _yaml

    tuned = sweeping.Tuned({"yaw_gain_ps": 4.2}, ())
    assert json.loads(json.dumps(_as_json(tuned)))["control"] == {"follow": {"yaw_gain_ps": 4.2}}
    assert _yaml(tuned).splitlines()[-1] == "    yaw_gain_ps: 4.2"
