"""A flight as operators' displays see it: orders by number and point, the map, the film; in simulated time."""

from __future__ import annotations

import asyncio
import math

import pytest

from control.engagement import State
from control.modes import FollowMode
from gcs.candidates import Candidate
from gcs.errors import SelectionError
from gcs.flight_orders import RefusedError
from gcs.flight_station import FlightStation
from gcs.flight_view import Sighting
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.operator.orders import Abort, Confirm, Deselect, Record, Select, SelectCandidate, SetMode
from gcs.recorder.film import FilmSwitch
from tests.gcs.fake_station import Quiet
from tests.gcs.standing_rig import Standing, standing


class Watching(Quiet):
    def __init__(self) -> None:
        self.seen: list[Sighting] = []

    def saw(self, sighting: Sighting) -> None:
        self.seen.append(sighting)


async def _story(loop: LockstepLoop) -> None:
    async with standing(loop) as flown:
        station = FlightStation(flown.world.flight, "SIM")
        await _look_and_select(flown, station)
        await _follow_and_abort(flown, station)
        station.close()


async def _look_and_select(flown: Standing, station: FlightStation) -> None:
    world = flown.world
    assert station.watermark == "SIM"
    assert station.size == (640, 480)
    assert station.hfov_rad == pytest.approx(world.flight.config.camera.hfov_deg * math.pi / 180, abs=0.02)
    watching = Watching()
    end = station.watch(watching)
    with pytest.raises(SelectionError, match="no candidate 4"):
        await station.perform(SelectCandidate(4))
    station._orders._candidates = lambda: (Candidate(4, flown.true_box()),)
    assert (await station.perform(SelectCandidate(4))).startswith("selected")
    await asyncio.sleep(0.5)
    assert station.status().state is State.SELECTED
    assert station.status().selection == 1
    assert await station.perform(Deselect()) == "nothing is selected"
    await asyncio.sleep(0.5)
    assert station.status().state is State.IDLE
    assert station.status().selection == 0
    assert watching.seen
    begun_s = asyncio.get_running_loop().time()
    boxes = (flown.true_box(), flown.true_box())
    first, second = await asyncio.gather(*(station.perform(Select(box)) for box in boxes))  # as nudging does
    assert (first, second.split()[0]) == ("another selection came right after it", "selected")
    assert asyncio.get_running_loop().time() < begun_s + 1.0
    await station.perform(Deselect())
    end()
    count = len(watching.seen)
    await asyncio.sleep(0.5)
    assert len(watching.seen) == count


async def _follow_and_abort(flown: Standing, station: FlightStation) -> None:
    world = flown.world
    with pytest.raises(RefusedError, match="no film"):
        await station.perform(Record())
    world.flight.film = FilmSwitch()
    await station.perform(Record())
    assert station.status().recording is False
    await station.perform(Record(True))
    assert station.status().recording is True
    assert station.refusals()
    await station.perform(SetMode(FollowMode.SPOTLIGHT))
    await station.perform(Select(flown.true_box(), station.frames.newest))
    await asyncio.sleep(1.0)
    assert station.refusals() == ()
    world.monitor.operator_confirms(asyncio.get_running_loop().time())
    await station.perform(Confirm())
    with pytest.raises(RefusedError, match="abort first"):
        await station.perform(Deselect())
    await asyncio.sleep(4.0)
    status, scene = station.status(), station.scene()
    assert (status.state, status.follow_mode, status.is_engaged) == (State.FOLLOWING, FollowMode.SPOTLIGHT, True)
    assert scene.target_m == pytest.approx(flown.stage.position_ned_m[:2], abs=3.0)
    assert scene.vehicle_m is not None
    assert scene.fence is not None
    assert len(scene.vehicle_path_m) >= 4
    assert len(scene.target_path_m) >= 3
    await station.perform(Abort())
    await asyncio.sleep(2.0)
    assert not station.status().is_engaged


def test_candidates_deselection_film_map_and_abort() -> None:
    lockstep.run(_story)
