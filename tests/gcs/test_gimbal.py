"""The Gimbal v2 messages to and from our types, and whom the station listens to."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.attitude import AttitudeBuffer
from control.gimbal import GimbalLimits, GimbalRequest
from gcs import gimbal_codec
from gcs.autopilot.px4 import Px4
from gcs.codec import VehicleId
from gcs.framing import CodecError, Deframer, Encoder, dialect
from gcs.gimbal import Gimbal, Hold
from gcs.gimbal_codec import Manager
from gcs.telemetry import Telemetry
from gcs.transport import Received
from gcs.wire import Wire
from sitl_mocks.vehicle.telemetry import quaternion

VEHICLE = VehicleId(1, 1, Px4())
MANAGER = Manager(VEHICLE, 154, GimbalLimits())
NAN = math.nan
EARTH, IN_VEHICLE, LOCK = 64, 32, 16


def received(message: Any, component: int, system: int = 1) -> Any:
    """As it comes out of the deframer."""
    return Deframer().datagram(Encoder(system, component).encode(message))[0]


def status(yaw_rad: float = 0.5, pitch_rad: float = -0.4, flags: int = EARTH, q: Any = None, device: int = 0) -> Any:
    message = dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, 0, flags, q or quaternion(0.1, pitch_rad, yaw_rad), NAN, NAN, NAN, 0, gimbal_device_id=device
    )
    return received(message, 154)


def information(device: int = 154, flags: int = 256 | 1024, yaw: tuple[float, float] = (-2.0, 2.0)) -> Any:
    limits = (0.0, 0.0, -1.5, 0.5, *yaw)
    return dialect.MAVLink_gimbal_manager_information_message(0, flags, device, *limits)


@pytest.mark.parametrize(
    ("flags", "from_north"),
    [(EARTH, True), (EARTH | LOCK, True), (IN_VEHICLE, False), (IN_VEHICLE | LOCK, False), (LOCK, True), (0, False)],
)
def test_the_attitude_and_what_its_yaw_counts_from(flags: int, from_north: bool) -> None:
    seen = gimbal_codec.attitude(status(flags=flags))
    assert seen is not None
    assert (seen.roll_rad, seen.pitch_rad, seen.yaw_rad) == pytest.approx((0.1, -0.4, 0.5), abs=1e-6)
    assert seen.from_north is from_north


@pytest.mark.parametrize("q", [[NAN] * 4, [0.0] * 4, [1.0, 0.0, math.inf, 0.0]])
def test_what_is_no_attitude_is_none(q: list[float]) -> None:
    assert gimbal_codec.attitude(status(q=q)) is None


def test_limits_as_told_and_none_where_they_are_nonsense() -> None:
    told = gimbal_codec.manager_of(received(information(), 1), VEHICLE)
    assert told.limits == GimbalLimits(pytest.approx(-1.5), pytest.approx(0.5), -2.0, 2.0)
    assert told.device.component_id == 154
    wrong = gimbal_codec.manager_of(received(information(yaw=(NAN, 1.0), flags=256), 1), VEHICLE)
    assert (wrong.limits.yaw_max_rad, wrong.limits.yaw_lock) == (math.inf, False)
    endless = gimbal_codec.manager_of(received(information(flags=256 | 2048), 1), VEHICLE)
    assert endless.limits.yaw_min_rad == -math.inf
    tilts = gimbal_codec.manager_of(received(information(flags=32), 1), VEHICLE)
    assert not tilts.limits.has_yaw
    assert gimbal_codec.manager_of(received(information(device=1), 1), VEHICLE).device == VEHICLE


@given(st.lists(st.floats(width=32), min_size=4, max_size=4), st.integers(0, 0xFFFF))
def test_whatever_comes_is_an_attitude_or_none(q: list[float], flags: int) -> None:
    seen = gimbal_codec.attitude(status(flags=flags, q=q))
    assert seen is None or all(map(math.isfinite, (seen.roll_rad, seen.pitch_rad, seen.yaw_rad)))


def test_rates_leave_as_pitch_and_yaw_rates_alone() -> None:
    message = received(gimbal_codec.rates(GimbalRequest(1.0, -0.2, 0.3), MANAGER), 191, 255)
    assert math.isnan(message.pitch)
    assert math.isnan(message.yaw)
    assert (message.pitch_rate, message.yaw_rate) == pytest.approx((-0.2, 0.3))
    assert message.flags == 4 | 8 | 16
    assert (message.target_system, message.target_component, message.gimbal_device_id) == (1, 1, 154)


@pytest.mark.parametrize("bad", [NAN, math.inf, 4.0])
def test_unusable_rates_do_not_leave(bad: float) -> None:
    with pytest.raises(CodecError):
        gimbal_codec.rates(GimbalRequest(1.0, 0.0, bad), MANAGER)


class Rig:
    """A wire that keeps what leaves, and a clock that is set."""

    def __init__(self, device_id: int | None = None) -> None:
        self.t_s = 10.0
        self.sent: list[Any] = []
        self.vehicle_attitude = AttitudeBuffer()
        self.wire = Wire.over(self._transport, clock=self)
        self.hear(dialect.MAVLink_heartbeat_message(2, 12, 0x81, 0, 4, 3), 1)
        telemetry = Telemetry(self.wire, self, attitude=self.vehicle_attitude)
        self.gimbal = Gimbal(self.wire, self, telemetry, device_id)

    def now_s(self) -> float:
        return self.t_s

    def _transport(self, take: Received) -> Any:
        self._take = take
        return self

    status, connections = "rig", 1

    def send(self, data: bytes) -> bool:
        self.sent += Deframer().datagram(data)
        return True

    def reply_to(self, peer: Any) -> None:
        pass

    def hear(self, message: Any, component: int, system: int = 1) -> None:
        self._take(Encoder(system, component).encode(message), ("vehicle", 1))

    def tick(self, request: GimbalRequest | None = None, n: int = 1) -> list[Any]:
        """n ticks; what left in them."""
        before = len(self.sent)
        for _ in range(n):
            self.t_s += 0.05
            self.gimbal.step(self.t_s, request)
        return self.sent[before:]

    def acknowledge(self, result: int = 0, to: tuple[int, int] = (255, 191), component: int = 1) -> None:
        self.hear(dialect.MAVLink_command_ack_message(1001, result, 0, 0, *to), component)

    def primary(self, system: int, component: int) -> None:
        self.hear(dialect.MAVLink_gimbal_manager_status_message(0, 0, 154, system, component, 0, 0), 1)


def configures(messages: list[Any]) -> list[float]:
    """param1 of each MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE."""
    return [m.param1 for m in messages if m.get_type() == "COMMAND_LONG" and m.command == 1001]


def rates(messages: list[Any]) -> list[tuple[float, float]]:
    return [(m.pitch_rate, m.yaw_rate) for m in messages if m.get_type() == "GIMBAL_MANAGER_SET_PITCHYAW"]


REQUEST = GimbalRequest(0.0, 0.25, 0.5)


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    rig.tick()
    rig.hear(information(), 1)
    return rig


def test_a_manager_is_asked_for_once_a_second_until_it_answers() -> None:
    rig = Rig()
    asked = rig.tick(n=41)
    assert [(m.command, m.param1, m.target_component) for m in asked] == [(512, 280, 1), (512, 280, 0), (512, 280, 1)]
    assert rig.gimbal.warnings(rig.t_s) == ("no gimbal manager answers: nothing can be followed",)
    rig.hear(information(), 1)
    streams = rig.tick()
    assert [(m.command, m.param1, m.target_component) for m in streams] == [(511, 285, 154), (511, 281, 1)]


def test_the_configured_device_is_waited_for() -> None:
    rig = Rig(device_id=155)
    rig.hear(information(154), 1)
    assert rig.gimbal.manager is None
    rig.hear(information(155), 68)
    assert rig.gimbal.manager is not None
    assert rig.gimbal.manager.vehicle.component_id == 68


def test_another_systems_gimbal_is_none_of_ours() -> None:
    rig = Rig()
    rig.hear(information(), 1, system=2)
    assert rig.gimbal.manager is None


def attitude_message(flags: int, yaw_rad: float = 0.5) -> Any:
    q = quaternion(0.0, -0.4, yaw_rad)
    return dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 0, flags, q, NAN, NAN, NAN, 0)


@pytest.mark.parametrize(("flags", "yaw_rad"), [(EARTH, 0.5), (IN_VEHICLE, 1.5)])
def test_the_state_is_in_ned_and_against_the_nose(rig: Rig, flags: int, yaw_rad: float) -> None:
    rig.hear(attitude_message(flags), 154)  # the vehicle's attitude is not known yet
    assert rig.gimbal.state(rig.t_s) is None
    for n in range(5):
        rig.t_s += 0.02
        rig.vehicle_attitude.add(rig.t_s, 0.0, 0.0, 1.0)
        rig.hear(attitude_message(flags, 0.5 + 0.01 * n), 154)
    state = rig.gimbal.state(rig.t_s)
    assert state is not None
    assert (state.pitch_rad, state.yaw_rad) == pytest.approx((-0.4, yaw_rad + 0.04), abs=1e-6)
    assert state.relative_yaw_rad == pytest.approx(yaw_rad + 0.04 - 1.0, abs=1e-6)
    assert state.yaw_rate_rps == pytest.approx(0.5, abs=1e-3)
    assert rig.gimbal.state(rig.t_s + 0.51) is None
    assert "not heard" in rig.gimbal.warnings(rig.t_s + 0.51)[0]


def test_attitudes_of_others_are_not_ours(rig: Rig) -> None:
    rig.hear(attitude_message(EARTH), 155)
    assert rig.gimbal.attitude.newest_t_s is None


def test_control_is_asked_for_then_used_then_given_back(rig: Rig) -> None:
    rig.tick()
    assert configures(rig.tick(REQUEST)) == [255]
    assert rig.tick(REQUEST, 3) == []  # not ours yet
    rig.acknowledge(to=(245, 190))  # somebody else's answer
    rig.acknowledge(component=2)
    rig.acknowledge(5)  # in progress
    assert rig.gimbal.hold is Hold.ASKED
    rig.acknowledge()
    assert rates(rig.tick(REQUEST, 2)) == [(0.25, 0.5)] * 2
    leaving = rig.tick(None, 4)
    assert rates(leaving) == [(0.0, 0.0)] * 3
    assert configures(leaving) == [-3]
    rig.acknowledge()
    assert rig.gimbal.hold is Hold.FREE
    after = rig.tick(None, 40)
    assert rates(after) == configures(after) == []


def test_what_gets_lost_is_tried_again_with_another_zero(rig: Rig) -> None:
    rig.tick(REQUEST)
    rig.primary(255, 191)
    assert rates(rig.tick(REQUEST)) == [(0.25, 0.5)]
    leaving = [m for m in rig.tick(None, 60) if m.get_type() != "COMMAND_LONG" or m.command == 1001]
    assert configures(leaving) == [-3] * 3
    assert rates(leaving) == [(0.0, 0.0)] * 5


def test_never_granted_it_is_refused_after_three_tries(rig: Rig) -> None:
    assert configures(rig.tick(REQUEST, 60)) == [255] * 3
    assert rig.gimbal.hold is Hold.REFUSED
    rig.tick(None)
    assert configures(rig.tick(REQUEST)) == [255]  # another follow asks again


def test_a_status_under_way_as_control_was_granted_is_no_loss(rig: Rig) -> None:
    rig.tick(REQUEST)
    rig.acknowledge()
    rig.primary(254, 190)
    assert rates(rig.tick(REQUEST, 12))
    rig.primary(254, 190)
    assert rig.gimbal.hold is Hold.TAKEN
    assert "system 254" in " ".join(rig.gimbal.warnings(rig.t_s))
    assert rates(rig.tick(REQUEST, 10)) == []
    assert rates(rig.tick(None, 10)) == []  # no zeros either: it is another's


def test_taken_while_being_given_back_is_left_alone(rig: Rig) -> None:
    rig.tick(REQUEST)
    rig.acknowledge()
    rig.tick(None)
    rig.primary(254, 190)
    assert rates(rig.tick(None, 20)) == []


def test_a_follow_begun_while_it_is_being_given_back_asks_again(rig: Rig) -> None:
    rig.tick(REQUEST)
    rig.acknowledge()
    rig.tick(None, 4)
    assert configures(rig.tick(REQUEST)) == [255]


def test_closed_it_listens_no_more(rig: Rig) -> None:
    rig.gimbal.close()
    rig.hear(attitude_message(EARTH), 154)
    assert rig.gimbal.attitude.newest_t_s is None
