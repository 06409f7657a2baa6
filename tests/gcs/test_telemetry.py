"""Telemetry, its texts and its stream requests, on a fake clock and without a socket."""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import development as mav

from control.types import VehicleMode
from gcs.autopilot import Stream
from gcs.autopilot.ardupilot import ArduCopter
from gcs.autopilot.mode_control import ModeControl
from gcs.autopilot.px4 import Px4
from gcs.clock import FakeClock
from gcs.codec import VehicleId
from gcs.errors import VehicleError
from gcs.framing import Deframer, Encoder
from gcs.slot import Slot, SlotClosedError
from gcs.statustext import StatusTextAssembler
from gcs.streams import StreamKeeper
from gcs.telemetry import LINK_LOST_S, Telemetry
from tests.gcs.wire_peer import PX4_LOITER, PX4_OFFBOARD, PX4_POSCTL, heartbeat

ATTITUDE, MODE = Stream(30, 50.0), Stream(436, 20.0)


class RecordingWire:
    """Stands in for a Wire: keeps what is sent, lets a test say what is received."""

    url = "udpin://127.0.0.1:14540"

    def __init__(self, autopilot=None):
        self.vehicle = VehicleId(1, 1, autopilot or Px4())
        self.sent = []
        self.subscribers = []

    def subscribe(self, subscriber):
        self.subscribers.append(subscriber)
        return lambda: self.subscribers.remove(subscriber)

    def send_message(self, message):
        self.sent.append(message)
        return True

    def hear(self, message, t_s, system_id=1, component_id=1):
        (decoded,) = Deframer().datagram(Encoder(system_id, component_id).encode(message))
        for subscriber in self.subscribers:
            subscriber(decoded, t_s)


@pytest.fixture
def wire():
    return RecordingWire()


@pytest.fixture
def clock():
    return FakeClock(100.0)


@pytest.fixture
def telemetry(wire, clock):
    return Telemetry(wire, clock)


def attitude(boot_ms=1000, roll=0.1):
    return mav.MAVLink_attitude_message(boot_ms, roll, 0.0, 0.5, 0.0, 0.0, 0.0)


def local(x=1.0):
    return mav.MAVLink_local_position_ned_message(1, x, 0.0, -5.0, 0.0, 0.0, 0.0)


def height(mm=5000):
    return mav.MAVLink_global_position_int_message(1, 0, 0, 0, mm, 0, 0, 0, 0)


def text(words, number=0, chunk=0, severity=4):
    return mav.MAVLink_statustext_message(severity, words.encode(), number, chunk)


def ack(command, result, system_id=255, component_id=191):
    return mav.MAVLink_command_ack_message(command, result, 0, 0, system_id, component_id)


def test_position_is_as_old_as_the_older_of_position_and_height(wire, telemetry):
    wire.hear(local(), 1.0)
    assert telemetry.vehicle_state().position_t_s is None
    wire.hear(height(), 2.0)
    assert telemetry.vehicle_state().position_t_s == 1.0
    wire.hear(local(), 3.0)
    assert telemetry.vehicle_state().position_t_s == 2.0
    wire.hear(local(x=float("nan")), 4.0)
    wire.hear(height(), 4.0)
    assert telemetry.vehicle_state().position_t_s == 3.0


def test_attitude_history_can_be_asked_between_samples(wire, telemetry):
    wire.hear(attitude(1000, 0.0), 1.00)
    wire.hear(attitude(1020, 0.2), 1.02)
    assert telemetry.attitude.at(1.01)[0] == pytest.approx(0.1)
    wire.hear(attitude(1040, float("nan")), 1.04)
    assert telemetry.attitude.at(1.02)[0] == pytest.approx(0.2)


def test_intended_mode_prearm_home_and_echo(wire, telemetry):
    assert telemetry.prearm_ok is None
    wire.hear(mav.MAVLink_current_mode_message(0, PX4_POSCTL, PX4_OFFBOARD), 1.0)
    for healthy, expected in ((0x10000000, True), (0, False)):
        sensors = 0x10000000
        wire.hear(mav.MAVLink_sys_status_message(sensors, sensors, healthy, 0, 0, 0, 50, 0, 0, 0, 0, 0, 0), 1.0)
        assert telemetry.prearm_ok is expected
    wire.hear(mav.MAVLink_home_position_message(473977420, 85455940, 488000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), 1.0)
    echo = mav.MAVLink_position_target_local_ned_message(1, 1, 0x5C7, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0)
    wire.hear(echo, 2.0)
    assert telemetry.vehicle_state().mode is VehicleMode.MANUAL
    assert telemetry.intended_mode is VehicleMode.EXTERNAL
    assert telemetry.home.latitude_deg == pytest.approx(47.397742)
    assert (telemetry.setpoint_echo.t_s, telemetry.setpoint_echo.velocity_ned_mps) == (2.0, (1.5, 0.0, 0.0))


def test_foreign_stations_are_noticed_and_other_vehicles_ignored(wire, telemetry):
    station = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    wire.hear(station, 1.0, 250, 190)
    wire.hear(station, 2.0, 255, 191)  # an echo of our own
    wire.hear(heartbeat(), 3.0, 2, 1)
    assert telemetry.foreign_stations == {(250, 190): 1.0}
    assert telemetry.vehicle_state().heartbeat_t_s is None


def test_answers_to_others_are_not_ours(wire, telemetry):
    wire.hear(ack(176, 4, 245, 190), 1.0)
    assert telemetry.ack_since(0.0, 176) is None
    wire.hear(ack(176, 1), 2.0)
    assert telemetry.ack_since(0.0, 176).result_name == "TEMPORARILY_REJECTED"
    assert telemetry.ack_since(2.5, 176) is None
    wire.hear(ack(400, 99), 3.0)
    assert telemetry.ack_since(0.0, 400).result_name == "result 99"


def test_streams_are_asked_for_on_connect_and_after_a_reconnect(wire, telemetry, clock):
    assert telemetry.ask(100.0) == 0  # nobody there
    wire.hear(heartbeat(), 100.0)
    wanted = {(stream.message_id, round(1e6 / stream.rate_hz)) for stream in Px4().streams}
    assert telemetry.ask(100.0) == len(wanted)
    assert {(m.param1, m.param2) for m in wire.sent} == wanted
    assert {m.command for m in wire.sent} == {511}
    assert telemetry.ask(100.5) == 0
    assert telemetry.ask(101.1) == len(wanted)  # none flows: asked again
    assert telemetry.ask(100.0 + LINK_LOST_S + 0.1) == 0  # gone: nothing to ask
    wire.hear(heartbeat(), 110.0)
    assert telemetry.reconnects == 1
    assert telemetry.ask(110.0) == len(wanted)
    assert "CURRENT_MODE" in telemetry.missing_streams(110.0)


def test_streams_are_asked_for_again_after_a_reboot(wire, telemetry):
    wire.hear(heartbeat(), 100.0)
    telemetry.ask(100.0)
    wire.hear(attitude(boot_ms=60_000), 100.1)
    wire.hear(attitude(boot_ms=59_990), 100.2)  # overtaken on the way, no reboot
    assert telemetry.reconnects == 0
    wire.hear(attitude(boot_ms=200), 100.5)
    assert telemetry.reconnects == 1
    assert telemetry.ask(100.5) == len(Px4().streams)


def test_current_mode_only_exists_on_px4():
    assert MODE.message_id in {stream.message_id for stream in Px4().streams}
    assert MODE.message_id not in {stream.message_id for stream in ArduCopter().streams}


def test_a_stream_is_asked_for_until_it_flows_with_growing_pauses():
    keeper = StreamKeeper((ATTITUDE, MODE))
    asked_at_s = []
    for n in range(4000):
        now_s = n * 0.01
        keeper.heard(ATTITUDE.message_id, now_s)  # 100 Hz: more than wanted
        due = keeper.due(now_s)
        if n > 0:
            assert ATTITUDE not in due
        if MODE in due:
            asked_at_s.append(now_s)
    assert asked_at_s == pytest.approx([0, 1, 3, 7, 15, 23, 31, 39])
    assert keeper.missing(40.0) == [MODE]


def test_a_stream_that_stops_or_is_too_slow_is_asked_for_again():
    keeper = StreamKeeper((MODE,))
    keeper.due(0.0)
    times = [n * 0.05 for n in range(1, 200)]
    for now_s in times:
        keeper.heard(436, now_s)
    assert keeper.due(times[-1]) == []
    assert keeper.due(times[-1] + 5.0) == [MODE]
    slow = StreamKeeper((MODE,))
    slow.due(0.0)
    for now_s in range(1, 10):  # 1 Hz instead of 20
        slow.heard(436, float(now_s))
    assert slow.due(9.0) == [MODE]


def messages(*parts):
    return [Deframer().datagram(Encoder(1, 1).encode(part))[0] for part in parts]


def test_chunks_become_one_text_without_px4s_tab():
    first, last = "Arming denied: Resolve system health failures firs", "t\t"
    assembler = StatusTextAssembler()
    one, two = messages(text(first, 7, 0), text(last, 7, 1))
    assert assembler.add(one, 1.0) == []
    (whole,) = assembler.add(two, 1.1)
    assert whole.text == "Arming denied: Resolve system health failures first"
    assert (whole.t_s, whole.severity) == (1.0, 4)


def test_chunks_in_any_order_and_two_texts_at_once():
    assembler = StatusTextAssembler()
    parts = messages(text("b" * 3, 8, 1), text("x" * 50, 9, 0), text("a" * 50, 8, 0), text("y", 9, 1))
    texts = [done.text for part in parts for done in assembler.add(part, 1.0)]
    assert texts == ["a" * 50 + "bbb", "x" * 50 + "y"]


def test_a_lost_chunk_shows_as_a_gap():
    assembler = StatusTextAssembler()
    parts = messages(text("a" * 50, 8, 0), text("end", 8, 2))
    assert [assembler.add(part, 1.0) for part in parts] == [[], []]
    assert assembler.expire(1.9) == []
    (torn,) = assembler.expire(2.1)
    assert torn.text == "a" * 50 + " … end"
    only_first = messages(text("b" * 50, 9, 0))[0]
    assembler.add(only_first, 5.0)
    assert assembler.expire(7.0)[0].text == "b" * 50 + " …"


def test_texts_cannot_write_to_the_terminal_or_fill_the_memory():
    assembler = StatusTextAssembler()
    (clean,) = assembler.add(messages(text("\x1b[31mred\r\n"))[0], 1.0)
    assert clean.text == "[31mred"
    for number in range(1, 1000):
        assembler.add(messages(text("a" * 50, number, 255))[0], 1.0)
        assembler.add(messages(text("a" * 50, number, 0))[0], 1.0)
    assert len(assembler._unfinished) <= 8


async def test_wait_for_is_woken_by_the_message_and_gives_up(wire, telemetry):
    waiting = asyncio.create_task(telemetry.wait_for(lambda s: s.armed, 5.0))
    await asyncio.sleep(0)
    wire.hear(heartbeat(base_mode=0x1D), 1.0)
    await asyncio.sleep(0)
    assert not waiting.done()
    wire.hear(heartbeat(base_mode=0x9D), 2.0)
    assert await waiting is True
    assert await telemetry.wait_for(lambda s: s.in_air, 0.01) is False
    assert telemetry._waiting == []


async def test_an_old_sight_of_the_mode_does_not_confirm_a_new_command(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    entering = asyncio.create_task(ModeControl(wire, telemetry, clock).enter_external())
    await asyncio.sleep(0)
    assert wire.sent[0].command == 176
    await asyncio.sleep(0.01)
    assert not entering.done()
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 100.1)
    await entering
    assert len(wire.sent) == 1


async def test_hold_gives_way_to_a_pilot(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold())
    await asyncio.sleep(0)
    wire.hear(heartbeat(custom_mode=PX4_POSCTL), 100.1)
    assert await holding is VehicleMode.MANUAL
    assert len(wire.sent) == 1


async def test_hold_is_confirmed_by_the_mode_not_by_the_answer(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold())
    await asyncio.sleep(0)
    wire.hear(ack(176, 0), 100.05)
    await asyncio.sleep(0.01)
    assert not holding.done()
    wire.hear(heartbeat(custom_mode=PX4_LOITER), 100.1)
    assert await holding is VehicleMode.HOLD


def test_no_vehicle_yet_is_a_clear_error(wire, telemetry):
    wire.vehicle = None
    with pytest.raises(VehicleError, match="no vehicle has been heard"):
        _ = telemetry.vehicle
    assert telemetry.vehicle_state().mode is VehicleMode.UNKNOWN


async def test_slot_keeps_only_the_newest():
    slot = Slot()
    slot.put(1)
    slot.put(2)
    assert await slot.get() == 2
    assert (slot.replaced, slot.take()) == (1, None)
    getting = asyncio.create_task(slot.get())
    await asyncio.sleep(0)
    assert not getting.done()
    slot.put(0)  # a false value is a value
    assert await getting == 0
    slot.put(3)
    slot.close()
    slot.put(4)
    assert await slot.get() == 3
    with pytest.raises(SlotClosedError):
        await slot.get()


def test_fake_clock_only_goes_forward():
    clock = FakeClock(5.0)
    assert clock.advance(0.5) == clock.now_s() == 5.5
    for bad in (-0.1, float("nan")):
        with pytest.raises(ValueError, match="cannot move"):
            clock.advance(bad)
