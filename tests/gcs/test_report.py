from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from control.causes import Cause
from control.engagement import State
from control.types import Reason
from gcs.config import Config, VideoConfig
from gcs.latency_budget import Budget
from gcs.link_meters import LinkFigures, WireCounters
from gcs.recorder.events import Ordered, Received, Refusals, Said, Selected
from gcs.recorder.manifest import Manifest, plain, write_manifest
from gcs.report.make import report_of
from gcs.report.reading import Reading
from gcs.report.sampling import Curve, Place, Rms, Spread, Stretches, Trail
from tests.gcs.report_rig import START_S, frame, status_text, tick, ticks, vehicle_frames, write_log
from tracker.box import Box


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Idle for 1 s, followed for 2, unseen for 0.5, followed for 1, released for 1."""
    entries = [
        *ticks(0.0, 1.0, State.IDLE),
        *ticks(1.0, 2.0, State.FOLLOWING),
        *ticks(3.0, 0.3, State.COASTING, Cause.TARGET_UNSEEN),
        *ticks(3.3, 0.2, State.LOST_HOLD, Cause.TARGET_AWAY),
        *ticks(3.5, 1.0, State.FOLLOWING),
        *ticks(4.5, 1.0, State.RELEASED, Cause.ABORT),
    ]
    return write_log(tmp_path / "flight", entries)


def test_what_was_followed_and_lost_is_added_up(folder: Path) -> None:
    found = report_of(folder)
    follow = found.following
    assert follow.confirmations == 1
    assert follow.seen_s == pytest.approx(3.0)
    assert follow.unseen_s == pytest.approx(0.5)
    assert (follow.losses, follow.reacquired) == (1, 1)
    assert follow.longest_loss_s == pytest.approx(0.5)
    assert follow.distance_rms_frac == pytest.approx(0.2)  # 12 m where 10 were to be held
    (one,) = found.follows
    assert (one.start_s, one.end_s) == (pytest.approx(1.0), pytest.approx(4.5))
    assert (one.mode, one.standoff_m) == ("follow", 10.0)
    assert one.ended == "with RELEASED: the operator stopped it"
    (loss,) = found.losses
    assert (loss.start_s, loss.end_s, loss.found) == (pytest.approx(3.0), pytest.approx(3.5), True)
    assert found.battery_frac == (0.75, 0.75)


def test_the_states_follow_each_other_without_a_gap(folder: Path) -> None:
    phases = report_of(folder).phases
    assert [one.name for one in phases] == ["idle", "following", "coasting", "lost, holding", "following", "released"]
    assert all(one.end_s == other.start_s for one, other in pairwise(phases))
    assert phases[2].reasons == ("the target is not seen",)
    assert phases[-1].end_s == pytest.approx(5.45)


def test_the_verdict_says_it_in_sentences(folder: Path) -> None:
    said = " ".join(report_of(folder).verdict)
    assert "followed for 0:03.5 after one confirmation, 86% of the time seen" in said
    assert "lost once and found again by itself; the longest took 0.5 s" in said
    assert "the distance was 20% off the standoff" in said
    assert "It ended with RELEASED: the operator stopped it." in said


def test_a_loss_that_ends_the_follow_was_not_found_again(tmp_path: Path) -> None:
    entries = [
        *ticks(0.0, 1.0, State.FOLLOWING),
        *ticks(1.0, 2.0, State.COASTING, Cause.TARGET_UNSEEN),
        *ticks(3.0, 0.5, State.RELEASED, Cause.TARGET_LOST),
    ]
    found = report_of(write_log(tmp_path / "flight", entries))
    assert (found.following.losses, found.following.reacquired) == (1, 0)
    assert not found.losses[0].found
    assert any("not every one ended with the target found again" in said for said in found.verdict)


def test_the_bearing_error_is_taken_against_where_the_camera_looked(tmp_path: Path) -> None:
    """The nose points north; the target is 0.1 rad to the right in one half of the frames, 0.3 in the other."""
    entries: list[tuple[float, object]] = []
    for n, (t_s, event) in enumerate(ticks(0.0, 2.0, State.FOLLOWING)):
        entries += [(t_s, event), (t_s, frame(t_s, 0.1 if n % 2 else 0.3))]
    found = report_of(write_log(tmp_path / "flight", entries))
    rms_rad = math.sqrt((0.01 + 0.09) / 2)
    assert found.following.bearing_rms_deg == pytest.approx(math.degrees(rms_rad), rel=0.01)


def test_limits_are_told_with_how_long_and_when(tmp_path: Path) -> None:
    entries: list[tuple[float, object]] = []
    for n in range(100):
        t_s = START_S + n * 0.05
        limited = ("speed",) if 20 <= n < 30 or 60 <= n < 70 else ()
        gate = Reason.FENCE if n == 80 else Reason.PASSED
        entries.append((t_s, tick(t_s, State.FOLLOWING, limited_by=limited, gate=gate)))
    found = report_of(write_log(tmp_path / "flight", entries))
    assert found.limits_s == {"speed": pytest.approx(1.0), "gate, trimmed: fence": pytest.approx(0.05)}
    speed = found.clipped[0]
    assert speed.spans == (
        (pytest.approx(0.95), pytest.approx(1.45)),
        (pytest.approx(2.95), pytest.approx(3.45)),
    )
    assert any("what the gate took away: fence" in said for said in found.verdict)


def test_the_latency_is_told_by_part_and_percentile(tmp_path: Path) -> None:
    """A hundred pictures, 1 to 100 ms in the tracker, 40 ms on the way here."""
    entries: list[tuple[float, object]] = []
    for n in range(100):
        t_s = START_S + n * 0.05
        budget = Budget(0.04, 0.0, 0.0, (n + 1) / 1000, 0.0, 0.0)
        entries.append((t_s, tick(t_s, State.FOLLOWING, budget=budget)))
    reading = Reading(write_log(tmp_path / "flight", entries))
    spread = reading.report.latency_ms
    assert (spread["track"].median_ms, spread["track"].p95_ms, spread["track"].p99_ms) == (50.0, 95.0, 99.0)
    assert (spread["total"].median_ms, spread["total"].p95_ms, spread["total"].p99_ms) == (90.0, 135.0, 139.0)
    assert spread["glass"].p99_ms == 40.0
    bins = reading.tally.latency.bins
    assert sum(found.count for found in bins.values()) == 100
    assert sum(sum(found.sums_s) for found in bins.values()) == pytest.approx(4.0 + 5.05)


def test_the_link_is_told_with_its_worst_and_its_rates(tmp_path: Path) -> None:
    entries = ticks(0.0, 5.0, State.IDLE)
    for n, loss_frac in enumerate((0.0, 0.5, 0.0, 0.25, 0.0)):  # half at first: the station was starting
        totals = WireCounters(setpoints_sent=20 * n, bytes_received=10_000 * n, bytes_sent=1000 * n, stale=n)
        figures = LinkFigures(100.0, 10_000.0, 20.0, 1000.0, loss_frac, 100 * n, 0, 0, totals)
        entries.append((START_S + n, figures))
    reading = Reading(write_log(tmp_path / "flight", sorted(entries, key=lambda entry: entry[0])))
    link = reading.report.link
    assert link is not None
    assert (link.most_loss_frac, link.setpoints_sent, link.dropped_late) == (0.25, 80, 4)
    assert link.received_kbps == pytest.approx(10.0)
    assert reading.tally.link.setpoints_hz.highest == pytest.approx(20.0)
    assert any("25% of the vehicle's messages were lost for a while" in said for said in reading.report.verdict)


def test_what_was_ordered_refused_and_said_is_in_order_of_time(tmp_path: Path) -> None:
    entries = [
        (START_S, Refusals(("no target is selected",))),
        *ticks(0.0, 1.0, State.IDLE),
        (START_S + 0.9, Said("IDLE")),
        (START_S + 0.5, Ordered("takeoff 9", "at 8.8 m")),  # written down once it was done
        (START_S + 0.2, Ordered("follow", "not following: no target is selected", True)),
        (START_S + 0.6, Received(status_text("Takeoff detected"))),
        (START_S + 0.7, Selected(1, Box.from_xywh(300.0, 200.0, 40.0, 30.0), None, 1)),
    ]
    found = report_of(write_log(tmp_path / "flight", entries))
    assert [(one.order, one.refused) for one in found.orders] == [("follow", True), ("takeoff 9", False)]
    assert [(one.by, one.text) for one in found.said] == [("vehicle", "Takeoff detected"), ("station", "IDLE")]
    assert found.refusals[0].reasons == ("no target is selected",)
    told = [event.text for event in found.timeline if event.kind == "operator"]
    assert told == ["orders follow: refused, not following: no target is selected", "orders takeoff 9: at 8.8 m"]
    tracker = [event.text for event in found.timeline if event.kind == "tracker"]
    assert tracker == ["is given box 1: 40x30 px at 300,200"]  # its corner, as in orders and answers


def test_of_a_log_from_elsewhere_the_vehicle_alone_is_told(tmp_path: Path) -> None:
    entries = [(t_s, Received(data)) for t_s, data in vehicle_frames(30.0)]
    reading = Reading(write_log(tmp_path / "flight", entries))
    found = reading.report
    assert found.autopilot == "ArduPilot"
    assert [event.text for event in found.timeline] == ["LOITER, armed"]
    assert found.battery_frac == (0.9, pytest.approx(0.61))
    assert reading.tally.height_m.highest == pytest.approx(15.0)
    norths = [place.north_m for place in reading.tally.vehicle_path.places]
    assert min(norths) == pytest.approx(-40.0, abs=0.1)  # the origin is where it was first
    assert found.verdict[0] == "Nothing was followed."


def test_a_flight_without_a_vehicle_is_told_too(tmp_path: Path) -> None:
    entries = [
        (START_S + n * 0.05, tick(START_S + n * 0.05, State.FOLLOWING, has_vehicle=False)) for n in range(40)
    ]  # fmt: skip
    reading = Reading(write_log(tmp_path / "flight", entries))
    assert reading.report.following.seen_s == pytest.approx(2.0)
    assert not reading.tally.vehicle_path.places
    assert reading.report.battery_frac is None


def test_a_curve_keeps_its_peaks_however_long_it_is() -> None:
    curve = Curve(most=50)
    for n in range(100_000):
        curve.add(n * 0.05, 7.0 if n == 54_321 else -7.0 if n == 77_777 else math.sin(n / 1000))
    points = [point for piece in curve.pieces for point in piece]
    assert len(points) <= 100
    assert (curve.highest, curve.lowest) == (7.0, -7.0)
    assert (54_321 * 0.05, 7.0) in points
    assert [t for t, _ in points] == sorted(t for t, _ in points)


def test_a_curve_is_parted_where_nothing_came() -> None:
    curve = Curve()
    for t_s in (0.0, 0.1, 0.2, 5.0, 5.1):
        curve.add(t_s, 1.0)
    curve.add(5.2, math.nan)
    assert [[t for t, _ in piece] for piece in curve.pieces] == [[0.0, 0.1, 0.2], [5.0, 5.1]]


def test_stretches_become_fewer_and_keep_their_sum() -> None:
    stretches = Stretches(most=10)
    for n in range(1000):
        stretches.add(n * 1.0, n * 1.0 + 0.5)
    assert len(stretches.spans) <= 10
    assert stretches.total_s == pytest.approx(500.0)
    assert (stretches.spans[0][0], stretches.spans[-1][1]) == (0.0, 999.5)


def test_percentiles_and_the_mean_square() -> None:
    spread, rms = Spread(), Rms()
    for n in range(1, 201):
        spread.add(n / 1000)
    assert [spread.percentile_ms(share) for share in (0.0, 0.5, 0.95, 1.0)] == [1.0, 100.0, 190.0, 200.0]
    with pytest.raises(ValueError, match="nothing"):
        Spread().percentile_ms(0.5)
    assert rms.value is None
    for value in (3.0, 4.0, math.inf):
        rms.add(value)
    assert rms.value == pytest.approx(math.sqrt(12.5))


def test_a_path_keeps_where_something_changed() -> None:
    trail = Trail(most=100)
    for n in range(10_000):
        trail.add(Place(n * 0.05, n * 0.1, 0.0, "other"))
    assert len(trail.places) <= 101
    trail.add(replace(trail.places[-1], kind="unseen"))
    assert trail.places[-1].kind == "unseen"


def test_of_an_imported_log_nothing_was_decided_here(tmp_path: Path) -> None:
    folder = write_log(tmp_path / "flight", ticks(0.0, 2.0, State.NO_VIDEO))
    manifest = Manifest(
        kind="import", started="2026-05-03T10:00:00Z", ended="2026-05-03T10:00:02Z", t_start_s=START_S,
        unix_start_s=1.7e9, software={}, machine={}, config=plain(Config(video=VideoConfig(fps=5.0))),
    )  # fmt: skip
    write_manifest(folder, manifest)
    found = report_of(folder)
    assert found.phases == ()
    assert [event.text for event in found.timeline] == ["external, armed"]
    assert found.longest_pause_s == 0.0
    assert found.provenance.changed == ()
    assert found.problems == ()  # without a film nothing is missing
    assert "Imported" in found.verdict[0]
