"""How a recording is steered: pace, pause, seek, single pictures, the end; with the real log, film and thread."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.clock import Clock, FakeClock, MonotonicClock
from gcs.operator.playback import Frames, Play, Seek, Speed
from gcs.replay.log import FlightLog, FrameRow
from gcs.replay.player import Delivered, End, Jump, Player
from gcs.replay.recorded import Moment, open_recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import glance
from tests.gcs.replay_rig import grey_of, record_flight

SOON_S = 20.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flight"))


class Running(FakeClock):
    """Time passes whenever somebody looks: nothing has to be waited for."""

    def now_s(self) -> float:
        return self.advance(0.05)


class Desk:
    """A player with its station; what was delivered is taken here, one after the other."""

    def __init__(self, folder: Path, clock: Clock, speed: float) -> None:
        self.recorded = open_recorded(folder)
        self.station = ReplayStation(self.recorded, glance(self.recorded))
        self.delivered: queue.Queue[Delivered] = queue.Queue()
        self.player = self.station.player = Player(self.recorded, clock, speed, self.delivered.put)

    def take(self) -> Delivered:
        delivered = self.delivered.get(timeout=SOON_S)
        self.station.deliver(delivered)
        return delivered

    def take_until(self, kind: type[Delivered]) -> list[Delivered]:
        taken = [self.take()]
        while not isinstance(taken[-1], kind):
            taken.append(self.take())
        return taken

    def pause(self) -> None:
        """What is on its way is taken too."""
        self.player.order(Play(on=False))
        self.station.steer(Seek(0.0))
        self.take_until(Jump)


@pytest.fixture
def desk(flown: Path) -> Iterator[Desk]:
    """Standing at the beginning."""
    opened = Desk(flown, MonotonicClock(), 1.0)
    opened.player.start()
    opened.pause()
    yield opened
    opened.player.close()


def test_all_is_delivered_in_its_order_and_then_the_end(flown: Path) -> None:
    desk = Desk(flown, Running(), 20.0)
    desk.player.start()
    *moments, end = desk.take_until(End)
    desk.player.close()
    assert isinstance(end, End)
    assert desk.station.playhead().has_ended
    assert not desk.station.playhead().is_playing
    times_s = [moment.t_s for moment in moments if isinstance(moment, Moment)]
    assert times_s == sorted(times_s)
    assert len(times_s) == sum(1 for _ in desk.recorded.moments(pictures=False))


def test_a_seek_shows_what_was_shown_there(desk: Desk) -> None:
    """As if it had been played up to there: state, picture, map and refusals."""
    station = desk.station
    played = ReplayStation(desk.recorded, glance(desk.recorded))
    moments = list(desk.recorded.moments())
    for t_s in (5.0, 3.0, 0.7, 4.5):
        station.steer(Seek(t_s))
        desk.take_until(Jump)
        played._forget()
        for moment in moments:
            if moment.t_s - desk.recorded.log.start_s > t_s:
                break
            played.took(moment)
        there, then = station.status(), played.status()
        assert station.playhead().t_s == pytest.approx(t_s, abs=0.06)
        assert (there.headline, there.vehicle, there.distance_m) == (then.headline, then.vehicle, then.distance_m)
        assert (there.budget, there.selection, there.link) == (then.budget, then.selection, then.link)
        assert station.refusals() == played.refusals()
        assert station.scene() == played.scene()
        assert station.playhead().frame == played.playhead().frame
        newest, expected = station.frames.newest, played.frames.newest
        assert newest is not None
        assert expected is not None
        assert (newest.image_bgr == expected.image_bgr).all()


def test_pictures_go_on_and_back_one_by_one(desk: Desk, flown: Path) -> None:
    numbers = [number for _, number, message in FlightLog(flown) if isinstance(message, FrameRow)]
    station, shown = desk.station, []
    station.steer(Seek(3.0))
    desk.take_until(Jump)
    start = station.playhead().frame
    assert start is not None
    for by in (1, 1, -1, -1, -1, 5):
        station.steer(Frames(by))
        desk.take_until(Jump)
        shown.append(station.playhead().frame)
        newest = station.frames.newest
        assert newest is not None
        assert int(newest.image_bgr[2, 2, 0]) == pytest.approx(grey_of(shown[-1] or 0), abs=3)
    at = numbers.index(start)
    assert shown == [numbers[at + off] for off in (1, 2, 1, 0, -1, 4)]
    assert not station.playhead().is_playing
    station.steer(Frames(-1000))
    desk.take_until(Jump)
    assert station.playhead().frame == numbers[0]
    station.steer(Frames(1000))
    desk.take_until(Jump)
    assert station.playhead().frame == numbers[-1]


def test_it_goes_on_from_where_it_was_sent_and_from_its_end_anew(flown: Path) -> None:
    desk = Desk(flown, Running(), 20.0)
    desk.player.start()
    desk.take_until(End)
    desk.station.steer(Seek(6.0))
    desk.take_until(Jump)
    assert not desk.station.playhead().has_ended
    desk.station.steer(Play())
    rest = desk.take_until(End)
    assert all(moment.t_s > desk.recorded.log.start_s + 5.9 for moment in rest if isinstance(moment, Moment))
    desk.station.steer(Play(on=True))
    first, *again = desk.take_until(End)
    assert isinstance(first, Jump)
    assert len(again) > len(rest)
    desk.player.close()


def test_a_speed_that_cannot_be_played_is_refused(desk: Desk) -> None:
    for times in (0.0, -1.0, 21.0, float("nan")):
        with pytest.raises(ValueError, match="speed"):
            desk.station.steer(Speed(times))
    desk.station.steer(Speed(4.0))
    desk.pause()
    assert desk.station.playhead().speed == 4.0


def test_pictures_that_come_too_late_are_left_out_but_no_decision(flown: Path) -> None:
    class Slow(FakeClock):
        def now_s(self) -> float:
            return self.advance(1.0)

    desk = Desk(flown, Slow(), 20.0)
    desk.player.start()
    moments = [moment for moment in desk.take_until(End) if isinstance(moment, Moment)]
    desk.player.close()
    assert sum(moment.image_bgr is not None for moment in moments) <= 1
    assert len(moments) == sum(1 for _ in desk.recorded.moments(pictures=False))
