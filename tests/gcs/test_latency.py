"""Where the time goes from light to command: measured on pictures, believed, summed up."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from control.attitude import AttitudeBuffer
from control.image_rotation import Flow, rotation_of_flow
from control.latency import PRIOR_S, DelayEstimate
from gcs.flight_vision import Seen
from gcs.glass_delay import GlassDelay
from gcs.latency_budget import Budget, BudgetDisplay, LatencyMeter
from gcs.video import Frame
from gcs.video.flow import BackgroundFlow
from sitl_mocks import scenario
from sitl_mocks.camera import RenderedCamera
from sitl_mocks.lens import Lens
from tests.gcs.flight_rig import BLANK, CAMERA
from tracker.box import Box

# -- the picture ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rendered() -> list[tuple[np.ndarray, Box, tuple[float, float, float]]]:
    """Pictures of the demo's world at 20 Hz from a vehicle that flies at 5 m/s and turns; target, attitude."""
    world = scenario.load("demo", 0).world
    camera, shots = RenderedCamera(world, Lens()), []
    for count in range(10):
        t_s = count / 20
        attitude = (0.05 * math.sin(5 * t_s), -0.1 + 0.05 * math.sin(7 * t_s), 0.4 * math.sin(2 * t_s))
        picture = camera.render(8.0 + t_s, (5.0 * t_s, 0.0, -9.0), *attitude)
        box = picture.truth[world.target_name].box_px
        assert box is not None
        shots.append((picture.image_bgr, Box.from_xywh(*box), attitude))
    return shots


def test_the_camera_s_turning_is_measured_in_painted_pictures(rendered) -> None:
    lens, flow, errors, turns = Lens(), BackgroundFlow(), [], []
    for count, (image, box, _) in enumerate(rendered):
        found = flow.update(image, 10.0 + count / 20, box)
        if count == 0:
            assert found is None
            continue
        assert found is not None
        assert (found.from_t_s, found.to_t_s) == pytest.approx((10.0 + (count - 1) / 20, 10.0 + count / 20))
        before, after = (lens.camera_from_ned(*rendered[at][2]) for at in (count - 1, count))
        turn = before @ after.T
        truth = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        measured = rotation_of_flow(CAMERA, found, after @ (0.0, 0.0, 1.0))
        assert measured is not None
        errors.append(measured - truth)
        turns.append(truth)
    assert np.sqrt(np.mean(np.square(errors))) < 0.1 * np.sqrt(np.mean(np.square(turns)))


def test_the_target_is_no_background(rendered) -> None:
    image, box, _ = rendered[0]
    large = replace(box, w_px=4 * box.w_px, h_px=4 * box.h_px)
    flow = BackgroundFlow()
    flow.update(image, 1.0, large)
    found = flow.update(rendered[1][0], 1.05, large)
    assert found is not None
    off = np.abs(found.from_px - (large.cx_px, large.cy_px)) / (large.w_px, large.h_px)
    assert np.all(off.max(axis=1) > 0.6)


def test_large_pictures_are_made_small_first(rendered) -> None:
    import cv2

    flow, small = BackgroundFlow(), BackgroundFlow()
    for at in (0, 1):
        image = rendered[at][0]
        many = flow.update(np.asarray(cv2.resize(image, (1920, 1440)), np.uint8), 1.0 + at / 20, None)
        few = small.update(image, 1.0 + at / 20, None)
    assert many is not None
    assert few is not None
    moved = [np.median(flow.to_px - flow.from_px, axis=0) for flow in (many, few)]
    assert moved[0] / 3 == pytest.approx(moved[1], abs=0.6)


@pytest.mark.parametrize("image", [np.zeros((480, 640, 3), np.uint8), np.zeros((1, 1, 3), np.uint8)])
def test_nothing_to_hold_on_to_is_no_flow(image: np.ndarray) -> None:
    flow = BackgroundFlow()
    assert [flow.update(image, 1.0 + at, None) for at in (0.0, 0.05, 0.1)] == [None] * 3


def test_a_pause_or_another_size_begins_anew(rendered) -> None:
    flow = BackgroundFlow()
    times_s = (1.0, 1.05, 2.0, 2.0)
    found = [flow.update(rendered[at][0], t_s, None) for at, t_s in enumerate(times_s)]
    assert [each is not None for each in found] == [False, True, False, False]
    assert flow.update(rendered[4][0][:, :320].copy(), 2.05, None) is None


# -- what is believed -----------------------------------------------------------------------------------------

NOTHING = np.zeros((0, 2))


def believed(given_s: float | None, estimates: Callable[[float], DelayEstimate], seconds: float) -> GlassDelay:
    glass = GlassDelay(given_s, CAMERA, AttitudeBuffer())
    for count in range(round(seconds * 20)):
        t_s = count / 20
        glass._estimator.estimate = estimates(t_s)
        before_s = glass.used_s
        glass.saw(Flow(t_s - 0.05, t_s, NOTHING, NOTHING))
        assert abs(glass.used_s - before_s) <= 0.05 * 0.05 + 1e-12  # never torn
    return glass


def test_what_is_used_moves_slowly_to_what_is_known() -> None:
    known = DelayEstimate(0.3, 0.005, known=True)
    glass = believed(None, lambda t_s: known, 1.0)
    assert glass.used_s == pytest.approx(PRIOR_S + 0.05, abs=1e-6)
    glass = believed(None, lambda t_s: known, 6.0)
    assert glass.used_s == pytest.approx(0.3)
    assert glass.correction_s() == pytest.approx(0.3 - PRIOR_S)
    assert glass.warnings() == ()


def test_what_is_not_known_is_not_used() -> None:
    glass = believed(None, lambda t_s: DelayEstimate(0.3, 0.1, known=False), 6.0)
    assert glass.used_s == PRIOR_S
    assert glass.correction_s() == 0.0


def test_a_given_delay_stays_and_a_lasting_difference_is_said() -> None:
    def off_by(error_s: float) -> Callable[[float], DelayEstimate]:
        return lambda t_s: DelayEstimate(0.2 + error_s, 0.005, known=True)

    assert believed(0.2, off_by(0.05), 6.0).warnings() == ()
    assert believed(0.2, off_by(0.08), 2.0).warnings() == ()  # not for long enough
    wrong = believed(0.2, off_by(0.08), 6.0)
    assert wrong.used_s == 0.2
    assert wrong.correction_s() == 0.0
    (said,) = wrong.warnings()
    assert "280 ms" in said
    assert "200" in said
    assert believed(0.2, lambda t_s: off_by(0.08 if t_s < 5.0 else 0.0)(t_s), 6.0).warnings() == ()


# -- the sum --------------------------------------------------------------------------------------------------


def test_the_budget_adds_up() -> None:
    frame = Frame(0, BLANK, t_capture_s=9.9, t_arrival_s=10.0, decode_s=0.004)
    seen = Seen(frame, 1, None, t_done_s=10.034, track_s=0.018)
    meter = LatencyMeter(unknown_link_s=0.075)
    assert meter.answered(10.0, None) is None
    meter.saw(seen)
    budget = meter.answered(10.059, 0.024)
    assert budget is not None
    assert str(budget) == "latency 183 ms (glass 100, decode 4, wait 12, tracker 18, control 25, link 24)"
    assert budget.total_s == pytest.approx(10.059 - 9.9 + 0.024)
    assert meter.answered(10.109, 0.024) is None  # each picture is answered once
    meter.saw(seen)
    unanswered = meter.answered(10.059, None)
    assert unanswered is not None
    assert unanswered.link_s == meter.link_s == 0.075
    meter.saw(seen)
    meter.forget()
    assert meter.answered(10.2, None) is None


def test_what_is_shown_is_the_median_of_the_last_second() -> None:
    display = BudgetDisplay()
    assert display.at(1.0) is None
    for count in range(30):
        display.note(count * 0.05, Budget(0.1, 0.004, 0.0, 0.5 if count == 25 else 0.02, 0.01 * (count >= 10), 0.0))
    shown = display.at(1.45)
    assert shown is not None
    assert (shown.glass_s, shown.track_s, shown.control_s) == (0.1, 0.02, 0.01)
    assert display.at(2.6) is None
