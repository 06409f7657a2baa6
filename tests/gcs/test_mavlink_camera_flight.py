"""The MAVLink camera before a whole flight in simulated time: select, see it, follow, know its place, abort."""

from __future__ import annotations

import asyncio
import contextlib
import struct

import pytest

from control.engagement import State
from control.geolocation import offset_from_m
from gcs.flight_place import place_of
from gcs.flight_station import FlightStation
from gcs.framing import dialect
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.operator.camera.component import CameraComponent
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask, Problem
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.lease import Lease
from tests.gcs.standing_rig import Standing, standing


class Client:
    """A ground station without sockets."""

    def __init__(self, flown: Standing, station: FlightStation) -> None:
        self.flown, self.world, self.station = flown, flown.world, station
        clock = self.world.flight.clock
        self.component = CameraComponent(
            CameraSetup(1, may_follow=True, display_delay_s=0.2), station, Lease(), clock.now_s(),
            lambda: place_of(self.world.flight),
        )  # fmt: skip
        station.watch(self.component.view)
        self._mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)

    async def send(self, message):
        """What comes back in the end."""
        heard = self._mav.decode(bytearray(message.pack(self._mav)))
        found = self.component.received(heard, None, self.world.flight.clock.now_s())
        for ask in [each for each in found if isinstance(each, Ask)]:
            problem = None
            try:
                await self.station.perform(ask.order)
            except ValueError as error:
                problem = Problem(Result.DENIED, str(error))
            found += self.component.settled(ask, problem, self.world.flight.clock.now_s())
        return [each.message for each in found if not isinstance(each, Ask)]

    async def command(self, number, *params):
        seven = (*params, *[0.0] * (7 - len(params)))
        return await self.send(dialect.MAVLink_command_long_message(1, 100, number, 0, *seven))

    async def status(self, message_id=275):
        *_, ack, status = await self.command(512, message_id)
        assert ack.result == 0
        return status

    async def follow(self, on):
        said = await self.send(dialect.MAVLink_param_ext_set_message(1, 100, b"FOLLOW", bytes([on]), 1))
        return [message.param_result for message in said if message.get_type() == "PARAM_EXT_ACK"]

    async def track(self):
        width, height = self.station.size
        x, y, w, h = self.flown.true_box().xywh
        said = await self.command(2005, x / width, y / height, (x + w) / width, (y + h) / height)
        assert [message.result for message in said if message.get_type() == "COMMAND_ACK"] == [0]


async def _story(loop: LockstepLoop) -> None:
    async with standing(loop) as flown:
        with contextlib.closing(FlightStation(flown.world.flight, "SIM")) as station:
            await _select_follow_abort(Client(flown, station))


async def _select_follow_abort(client: Client) -> None:
    station, world = client.station, client.world
    assert (await client.status()).tracking_status == 0
    await client.track()
    await asyncio.sleep(1.0)
    status = await client.status()
    assert status.tracking_status in (1, 9)
    assert status.tracking_mode == 2
    width, height = station.size
    truth = client.flown.true_box()
    assert (status.rec_top_x + status.rec_bottom_x) / 2 * width == pytest.approx(truth.cx_px, abs=truth.w_px)
    assert (status.rec_top_y + status.rec_bottom_y) / 2 * height == pytest.approx(truth.cy_px, abs=truth.h_px)

    world.monitor.operator_confirms(asyncio.get_running_loop().time())
    assert await client.follow(1) == [0]
    await asyncio.sleep(3.0)
    assert station.status().state is State.FOLLOWING
    geo = await client.status(276)
    assert geo.tracking_status in (1, 9)
    assert geo.dist > 3.0
    home = world.flight.link.telemetry.home
    north_east = offset_from_m((geo.lat / 1e7, geo.lon / 1e7), (home.latitude_deg, home.longitude_deg))
    assert north_east == pytest.approx(client.flown.stage.position_ned_m[:2], abs=3.0)
    assert geo.alt == pytest.approx(home.altitude_m, abs=2.0)
    said = await client.command(2005, 0.1, 0.1, 0.2, 0.2)
    assert said[0].result == 1
    assert "abort first" in said[1].text

    assert await client.follow(0) == [0]
    await asyncio.sleep(2.0)
    assert station.status().state is State.RELEASED
    value = struct.pack("<f", 12.0)
    said = await client.send(dialect.MAVLink_param_ext_set_message(1, 100, b"FOLLOW_STANDOFF", value, 9))
    assert said[0].param_result == 0
    assert world.flight.control.wanted.standoff_m == 12.0


def test_a_flight_steered_and_told_by_a_mavlink_camera() -> None:
    lockstep.run(_story)
