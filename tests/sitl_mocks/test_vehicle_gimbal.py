"""The mocked gimbal against pymavlink's own messages and, once, against a real MAVSDK."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest
from mavsdk.asyncio.plugins.gimbal import GimbalAsync
from mavsdk.plugins.gimbal import ControlMode, GimbalMode, SendMode
from pymavlink.dialects.v20 import common as mavlink

from sitl_mocks.vehicle import MockGimbal, MockVehicle
from sitl_mocks.vehicle.link import decode_datagram
from tests.sitl_mocks.test_vehicle_mavsdk import flying, wait_for

STATION, OTHER = (255, 191), (254, 190)
NAN = math.nan


class Peer:
    """A station on the mock's link, with a time of its own."""

    def __init__(self, gimbal: MockGimbal, yaw_rad: float = 0.0) -> None:
        self.vehicle = MockVehicle("px4", airborne_m=10.0, rates_hz={}, gimbal=gimbal, yaw_rad=yaw_rad)
        self.gimbal, self.now_s = gimbal, 0.0
        self.heard: list[Any] = []
        self.run(0.1)

    def send(self, message: Any, sender: tuple[int, int] = STATION) -> None:
        frame = message.pack(mavlink.MAVLink(None, *sender))
        self._hear(self.vehicle.receive(frame, self.now_s))

    def command(self, number: int, *params: float, component: int = 1, sender: tuple[int, int] = STATION) -> None:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send(mavlink.MAVLink_command_long_message(1, component, number, 0, *padded), sender)

    def rates(self, pitch_rps: float, yaw_rps: float, sender: tuple[int, int] = STATION, flags: int = 28) -> None:
        message = mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, flags, 154, NAN, NAN, pitch_rps, yaw_rps)
        self.send(message, sender)

    def take(self, sender: tuple[int, int] = STATION) -> None:
        self.command(1001, *sender, -1, -1, 0, 0, 154, sender=sender)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += 0.01
            self._hear(self.vehicle.step(self.now_s))

    def _hear(self, datagrams: list[bytes]) -> None:
        self.heard += [message for data in datagrams for message in decode_datagram(data)]

    def last(self, kind: str) -> Any:
        return next(message for message in reversed(self.heard) if message.get_type() == kind)


def test_manager_answers_as_the_autopilot_and_device_as_itself() -> None:
    peer = Peer(MockGimbal())
    peer.command(512, 280)
    peer.command(512, 283, component=154)
    peer.run(0.2)
    manager = peer.last("GIMBAL_MANAGER_INFORMATION")
    assert (manager.get_srcComponent(), manager.gimbal_device_id) == (1, 154)
    assert manager.pitch_min == pytest.approx(math.radians(-90))
    assert peer.last("GIMBAL_DEVICE_INFORMATION").get_srcComponent() == 154
    assert peer.last("GIMBAL_DEVICE_ATTITUDE_STATUS").get_srcComponent() == 154
    assert peer.last("COMMAND_ACK").result == 0


def test_only_who_is_in_control_turns_it() -> None:
    peer = Peer(MockGimbal())
    peer.rates(0.0, 0.5)
    peer.command(1000, NAN, NAN, 0.0, 20.0, 28, 0, 154)
    peer.run(0.2)
    assert peer.gimbal.command == ("rate", 0.0, 0.0)
    assert peer.last("COMMAND_ACK").result == 2
    peer.take()
    peer.rates(0.0, 0.5)
    assert peer.gimbal.command == ("rate", 0.0, 0.5)
    peer.take(OTHER)
    peer.rates(0.0, 0.0)
    assert peer.gimbal.command == ("rate", 0.0, 0.5)
    peer.run(0.1)
    assert peer.last("GIMBAL_MANAGER_STATUS").primary_control_sysid == 254
    peer.command(1001, -3, -3, -3, -3, 0, 0, 154)  # not ours to give back
    assert peer.gimbal.primary == OTHER
    peer.command(1001, -3, -3, -3, -3, 0, 0, 154, sender=OTHER)
    assert peer.gimbal.primary == (0, 0)


def test_a_rate_stays_in_force_until_the_stop() -> None:
    peer = Peer(MockGimbal())
    peer.take()
    peer.rates(-0.5, 0.5)
    peer.run(1.0)
    assert peer.gimbal.yaw_rad == pytest.approx(0.45, abs=0.02)  # the response takes a tenth of a second
    assert peer.gimbal.pitch_rad == pytest.approx(-0.45, abs=0.02)
    peer.run(9.0)
    assert peer.gimbal.relative_yaw_rad == pytest.approx(math.radians(150))
    assert peer.gimbal.pitch_rad == pytest.approx(math.radians(-90))


@pytest.mark.parametrize("locked", [True, False])
def test_a_locked_yaw_does_not_notice_the_vehicle_turn(locked: bool) -> None:
    peer = Peer(MockGimbal(), yaw_rad=0.3)
    peer.take()
    peer.rates(0.0, 0.0, flags=28 if locked else 12)
    peer.run(0.05)
    peer.vehicle.autopilot.flight.body.motion.yaw_rad += 0.5
    peer.run(0.2)
    assert peer.gimbal.yaw_rad == pytest.approx(0.3 if locked else 0.8, abs=1e-6)
    assert peer.gimbal.relative_yaw_rad == pytest.approx(-0.5 if locked else 0.0, abs=1e-6)


def test_an_angle_is_taken_and_kept() -> None:
    peer = Peer(MockGimbal())
    peer.take()
    peer.command(1000, -40.0, 30.0, NAN, NAN, 28, 0, 154)
    peer.run(3.0)
    assert peer.gimbal.rpy_rad == pytest.approx((0.0, math.radians(-40), math.radians(30)), abs=0.02)
    q = peer.last("GIMBAL_DEVICE_ATTITUDE_STATUS").q
    assert 2 * math.atan2(q[3], q[0]) == pytest.approx(math.radians(30), abs=0.06)


@pytest.mark.slow
async def test_mavsdk_lists_it_takes_control_and_turns_it() -> None:
    vehicle = MockVehicle("px4", airborne_m=10.0, gimbal=MockGimbal(pitch_rad=-0.3))
    gimbal = vehicle.gimbal
    assert gimbal is not None
    async with flying(vehicle) as system:
        plugin = GimbalAsync(system)
        found = await wait_for(plugin.subscribe_gimbal_list(), lambda each: bool(each.gimbals))
        number = found.gimbals[0].gimbal_id
        await plugin.take_control(number, ControlMode.PRIMARY)
        assert gimbal.primary == (245, 190)
        await plugin.set_angular_rates(number, 0.0, -5.0, 10.0, GimbalMode.YAW_LOCK, SendMode.STREAM)

        def turned(attitude: Any) -> bool:
            return attitude.euler_angle_north.yaw_deg > 2.0 and attitude.euler_angle_north.pitch_deg < -18.0

        await wait_for(plugin.subscribe_attitude(), turned)
        assert gimbal.locked
        assert gimbal.command == pytest.approx(("rate", math.radians(-5), math.radians(10)))
        await plugin.set_angular_rates(number, 0.0, 0.0, 0.0, GimbalMode.YAW_LOCK, SendMode.STREAM)
        await plugin.release_control(number)
        async with asyncio.timeout(5.0):
            while gimbal.primary != (0, 0) or gimbal.command != ("rate", 0.0, 0.0):
                await asyncio.sleep(0.02)
