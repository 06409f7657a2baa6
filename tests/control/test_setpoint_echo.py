"""The vehicle's echo against what was sent: healthy links are left alone, dead and shared ones are found in time."""

import math
import random

import pytest

from control.setpoint_echo import EchoMonitor

TICK = 0.05


class Link:
    """We send a turning velocity at 20 Hz; the vehicle echoes what it took last, at echo_hz and delay_s late."""

    def __init__(self, echo_hz=5.0, delay_s=0.1, speed_mps=4.0):
        self.monitor, self.now, self.echo_hz, self.delay_s, self.speed = (
            EchoMonitor(),
            50.0,
            echo_hz,
            delay_s,
            speed_mps,
        )
        self.taken, self.echo, self.next_echo, self.in_flight = (0.0, 0.0, 0.0), None, 50.0, []

    def tick(self, uplink=True, foreign=None, loss=0.0, rng=None):
        """One tick; foreign: what somebody else sends every time after us. Returns (lost, foreign)."""
        self.now += TICK
        self.monitor.judge(self.now, *(self.echo or (None, (0.0, 0.0, 0.0))))
        verdict = self.monitor.is_lost, self.monitor.is_foreign
        velocity = (self.speed * math.cos(self.now), self.speed * math.sin(self.now), 0.2)
        self.monitor.sent(self.now, velocity)
        if uplink and not (rng and rng.random() < loss):
            self.taken = velocity
        if foreign is not None and (rng is None or rng.random() < 0.5):
            self.taken = foreign
        if self.echo_hz and self.now >= self.next_echo:
            self.next_echo += 1 / self.echo_hz
            self.in_flight.append((self.now + self.delay_s, self.taken))
        while self.in_flight and self.in_flight[0][0] <= self.now:
            arrived = self.in_flight.pop(0)
            if not (rng and rng.random() < loss):
                self.echo = arrived
        return verdict

    def until(self, which, seconds, **kinds):
        """Seconds until the verdict, None if it does not come."""
        start = self.now
        while self.now < start + seconds:
            if self.tick(**kinds)[which]:
                return self.now - start
        return None


LOST, FOREIGN = 0, 1


@pytest.mark.parametrize("echo_hz", [5.0, 10.0, 50.0])
@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_healthy_link_is_never_accused(echo_hz, delay_s, loss):
    link, rng = Link(echo_hz, delay_s), random.Random(1)
    for _ in range(1200):
        assert link.tick(loss=loss, rng=rng) == (False, False)
    assert link.echo is not None


@pytest.mark.parametrize("echo_hz", [5.0, 10.0, 50.0])
@pytest.mark.parametrize("phase", range(5))
def test_a_vehicle_that_no_longer_hears_us_is_found_within_a_second_and_a_half(echo_hz, phase):
    link = Link(echo_hz)
    assert link.until(LOST, 5.0 + phase * TICK) is None
    found = link.until(LOST, 5.0, uplink=False)
    assert found is not None
    assert 1.0 < found <= 1.5
    assert not link.monitor.is_foreign  # what it still does was ours


def test_it_is_no_longer_accused_when_it_hears_us_again():
    link = Link()
    link.until(LOST, 5.0, uplink=False)
    assert link.monitor.is_lost
    for _ in range(12):
        link.tick()
    assert not link.monitor.is_lost


def test_a_stream_that_begins_again_gets_the_same_patience():
    link = Link()
    link.until(LOST, 3.0)
    for _ in range(60):  # nothing is sent for 3 s, the vehicle stays in external control
        link.now += TICK
        link.monitor.judge(link.now, link.now, (0.0, 0.0, 0.0))
        assert not link.monitor.is_lost
    link.next_echo = link.now
    assert link.until(LOST, 1.0, uplink=False) is None


def test_a_vehicle_that_stops_by_itself_does_not_hear_us_either():
    link = Link()
    link.until(LOST, 3.0)
    link.taken = (0.0, 0.0, 0.0)
    found = link.until(LOST, 3.0, uplink=False)
    assert found is not None
    assert not link.monitor.is_foreign


@pytest.mark.parametrize("echo_hz", [10.0, 50.0])
def test_somebody_elses_setpoints_are_found_within_a_second_and_a_half(echo_hz):
    for seed in range(50):
        link, rng = Link(echo_hz), random.Random(seed)
        assert link.until(FOREIGN, 3.0) is None
        found = link.until(FOREIGN, 5.0, foreign=(-6.0, 3.0, 0.0), rng=rng)
        assert found is not None
        assert found <= 1.5, f"seed {seed}"


def test_a_vehicle_that_echoes_nothing_is_not_judged():
    link = Link(echo_hz=0.0)
    for _ in range(200):
        assert link.tick(uplink=False) == (False, False)


def test_an_echo_that_stops_is_not_judged_for_long():
    link = Link()
    link.until(LOST, 2.0)
    link.echo_hz = 0.0
    for _ in range(200):
        assert link.tick() == (False, False)


def test_what_the_vehicle_does_while_we_send_nothing_is_not_judged():
    """ArduCopter climbs after take-off in its external mode, and says so."""
    monitor = EchoMonitor()
    for step in range(100):
        now = 10.0 + step * TICK
        monitor.judge(now, now, (0.0, 0.0, -2.0))
        assert not monitor.is_foreign
        assert not monitor.is_lost
    for step in range(8):  # and for a moment after we have begun
        now = 15.0 + step * TICK
        monitor.judge(now, now, (0.0, 0.0, -2.0))
        monitor.sent(now, (0.0, 0.0, 0.0))
        assert not monitor.is_foreign


def test_what_was_found_is_forgotten_with_the_stream_or_the_mode():
    for forget in ("pause", "reset"):
        link = Link(echo_hz=50.0)
        link.until(FOREIGN, 2.0)
        assert link.until(FOREIGN, 2.0, foreign=(-6.0, 3.0, 0.0)) is not None
        if forget == "pause":
            link.monitor.judge(link.now + 0.5, link.now + 0.5, (-6.0, 3.0, 0.0))
        else:
            link.monitor.reset()
        assert not link.monitor.is_foreign


def test_one_strange_echo_alone_is_forgotten():
    link = Link()
    link.until(FOREIGN, 2.0)
    for _ in range(3):
        link.monitor.judge(link.now, link.now, (-9.0, 9.0, 0.0))  # the same one again and again
        assert link.until(FOREIGN, 2.2) is None


def test_a_standing_vehicle_and_a_small_difference_are_no_reason():
    monitor = EchoMonitor()
    for step in range(200):
        now = 10.0 + step * TICK
        monitor.judge(now, now, (0.3, -0.3, 0.1))
        assert not monitor.is_lost
        assert not monitor.is_foreign
        monitor.sent(now, (0.0, 0.0, 0.0))
