"""The two ways out, part by part: what leaves, by whose permit, and what a command line may ask for."""

from __future__ import annotations

import math

import pytest

from control.types import VehicleMode
from gcs import codec, launch
from gcs.audit import AuditError, Level, judge, known_name, rules_of
from gcs.audit_follow_mode import own_place
from gcs.autopilot.ardupilot import ArduCopter
from gcs.autopilot.px4 import Px4
from gcs.backend import Backend
from gcs.cli.entry import build_parser
from gcs.codec import PublishedTarget
from gcs.errors import ConfigError
from gcs.framing import CodecError, Deframer, Encoder
from gcs.pinning import VehiclePin
from tests.gcs.wire_peer import heartbeat

TARGET = PublishedTarget(47.3977421, 8.5455941, 489.5, (1.0, -2.0, 0.0), (0.5, 0.2, 0.4))
FOLLOW = Backend.FOLLOW_TARGET


def test_follow_target_says_position_and_velocity_and_nothing_more() -> None:
    (message,) = Deframer().datagram(Encoder(255, 191).encode(codec.follow_target(TARGET, 1234)))
    assert message.get_type() == "FOLLOW_TARGET"
    assert (message.timestamp, message.est_capabilities) == (1234, 0b11)
    assert (message.lat, message.lon) == (473977421, 85455941)
    assert message.alt == pytest.approx(489.5)
    assert message.vel == pytest.approx([1.0, -2.0, 0.0])
    assert message.attitude_q == [1.0, 0.0, 0.0, 0.0]
    assert message.position_cov == pytest.approx([0.25, 0.04, 0.16])


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_target_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(CodecError, match="not finite"):
        codec.follow_target(PublishedTarget(bad, 8.5, 489.5, (1.0, -2.0, 0.0), (0.5, 0.2, 0.4)), 0)


def test_it_moves_a_vehicle_so_nobody_sends_it_past_the_gate() -> None:
    assert codec.follow_target(TARGET, 0).get_msgId() in codec.MOVING_MESSAGES


@pytest.mark.parametrize(("autopilot", "own", "steered"), [(Px4(), 4 << 16 | 8 << 24, 6 << 16), (ArduCopter(), 23, 4)])
def test_the_external_mode_is_the_backends(autopilot: Px4 | ArduCopter, own: int, steered: int) -> None:
    assert autopilot.mode_of(steered) is VehicleMode.EXTERNAL
    assert autopilot.mode_of(own) is VehicleMode.OTHER
    by_target = autopilot.by(FOLLOW)
    assert by_target.mode_of(own) is VehicleMode.EXTERNAL
    assert by_target.mode_of(steered) is VehicleMode.OTHER
    main, sub = by_target.mode_params(VehicleMode.EXTERNAL)
    assert own == (int(main) << 16 | int(sub) << 24 if isinstance(autopilot, Px4) else int(main))
    assert by_target.mode_params(VehicleMode.HOLD) == autopilot.mode_params(VehicleMode.HOLD)


def test_the_pinned_vehicle_is_known_by_its_backend() -> None:
    pin = VehiclePin(None, FOLLOW)
    (message,) = Deframer().datagram(Encoder(1, 1).encode(heartbeat()))
    assert pin.is_ours(message, 0.0)
    assert pin.is_ours(message, 1.0)
    assert pin.vehicle is not None
    assert pin.vehicle.autopilot == Px4(backend=FOLLOW)


GOOD = {
    "FOLL_ENABLE": 1, "FOLL_SYSID": 255, "FOLL_OFS_TYPE": 0, "FOLL_YAW_BEHAVE": 1, "FOLL_DIST_MAX": 100,
    "FOLL_OFS_X": 0, "FOLL_OFS_Y": 0, "FOLL_OFS_Z": 0, "WPNAV_SPEED": 500,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "unsafe"),
    [
        ({}, set()),
        ({"FOLL_OFS_X": -8, "FOLL_OFS_Y": 6, "FOLL_OFS_Z": -10}, set()),
        ({"FOLL_OFS_X": -10}, {"FOLL_OFS_Z"}),  # it would sink to the target's height
        ({"FOLL_OFS_Z": -10}, {"FOLL_OFS_X", "FOLL_OFS_Y"}),  # straight above
        ({"FOLL_OFS_X": -2, "FOLL_OFS_Z": -10}, {"FOLL_OFS_X", "FOLL_OFS_Y"}),
        ({"FOLL_SYSID": 0}, {"FOLL_SYSID"}),
        ({"FOLL_OFS_TYPE": 1}, {"FOLL_OFS_TYPE"}),
        ({"FOLL_YAW_BEHAVE": 0}, set()),
    ],
)
def test_arducopters_offsets_are_judged_together(changes: dict[str, float], unsafe: set[str]) -> None:
    audit = judge("ArduCopter", {**GOOD, **changes}, backend=FOLLOW)
    found = {f.name for f in audit.findings if f.name.startswith("FOLL") and f.level is Level.UNSAFE}
    assert found == unsafe


def test_what_is_asked_of_the_vehicle_depends_on_the_backend() -> None:
    names = {name for rule in rules_of("PX4", FOLLOW) for name in rule.names}
    assert "FLW_TGT_DST" in names
    assert "COM_OF_LOSS_T" not in names  # there is no offboard stream to lose
    assert {"GF_ACTION", "NAV_DLL_ACT", "GF_MAX_HOR_DIST"} < names
    assert not any("FLW_TGT" in name for rule in rules_of("PX4") for name in rule.names)
    assert known_name("flw_tgt_dst") == "FLW_TGT_DST"
    with pytest.raises(AuditError):
        known_name("FLW_TGT_FA")


def test_where_the_vehicle_will_be_is_said() -> None:
    assert own_place("PX4", {}).text == "8 m away, 8 m above home"
    assert own_place("PX4", {"FLW_TGT_DST": 12, "FLW_TGT_ALT_M": 2}).text == "12 m away, 8 m above the target"
    assert own_place("ArduCopter", GOOD).distance_m is None
    place = own_place("ArduCopter", {**GOOD, "FOLL_OFS_X": -8, "FOLL_OFS_Y": 6, "FOLL_OFS_Z": -10})
    assert (place.distance_m, place.height_m) == (10.0, 10.0)
    assert place.text == "-8 m north and 6 m east of the target, 10 m above it"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("follow:\n  mode: spotlight\n", r"own follow mode .* cannot do follow.mode spotlight"),
        ("gimbal:\n  enabled: true\n", r"points the gimbal itself"),
    ],
)
def test_what_the_vehicle_does_itself_is_refused(tmp_path, text: str, reason: str) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "gcs.yaml"
    file.write_text(text)
    args = build_parser().parse_args(["run", "--config", str(file), "--video", "x", "--backend", "follow-target"])
    with pytest.raises(ConfigError, match=reason):
        launch.main(args)
