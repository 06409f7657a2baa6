"""Signing on a wire: signed by us and understood by pymavlink, signed by pymavlink and believed by us, nothing else."""

from __future__ import annotations

import os
import random
import time
from collections import Counter

import pytest
from pymavlink.dialects.v20 import development as mav

from gcs import codec
from gcs.clock import FakeClock
from gcs.framing import Encoder
from gcs.keys import KeyFileError, SigningKey, write_key
from gcs.signing import Signing, Verdict, security
from gcs.signing_time import EPOCH_UNIX_S, MARGIN, UNITS_PER_S
from gcs.wire import Wire
from tests.gcs.signing_peer import OTHER, SECRET, attack, digest, signer, verifier
from tests.gcs.wire_peer import Loopback, heartbeat, setpoint

VEHICLE = ("vehicle", 1)


def now_units() -> int:
    return int((time.time() - EPOCH_UNIX_S) * UNITS_PER_S)


class Link:
    """A signed wire without a socket, on a clock that stands still."""

    def __init__(self, folder, secret=SECRET):
        self.path = folder / "signing.key"
        if not self.path.exists():
            write_key(self.path, SigningKey(secret))
        self.clock = FakeClock(50.0)
        self.signing = Signing.open(self.path, self.clock)
        self.believed = []
        self.wire = Wire.over(self._make, clock=self.clock, signing=self.signing)
        self.wire.subscribe(lambda message, t_s: self.believed.append(bytes(message.get_msgbuf())))

    def _make(self, received):
        self.transport = Loopback(received)
        return self.transport

    def hear(self, frame: bytes) -> bool:
        """Whether it was believed."""
        before = len(self.believed)
        self.transport.received(bytes(frame), VEHICLE)
        return len(self.believed) > before


@pytest.fixture
def link(tmp_path):
    return Link(tmp_path)


def test_what_we_send_is_signed_and_pymavlink_believes_it(link):
    assert link.hear(heartbeat().pack(signer(timestamp=now_units())))
    theirs = Encoder(245, 190)  # MAVSDK's frames come as bytes
    assert link.wire.send_heartbeat()
    assert link.wire.send_raw(theirs.encode(codec.heartbeat()), 50.0)
    assert link.wire.send_setpoint(setpoint(50.0))
    assert link.wire.send_raw(
        theirs.encode(codec.heartbeat()) + theirs.encode(mav.MAVLink_ping_message(1, 1, 0, 0)), 50.0
    )
    parser = verifier()
    read = [message for data in link.transport.sent for message in parser.parse_buffer(data)]
    assert [(m.get_type(), m.get_srcSystem(), m.get_signed()) for m in read] == [
        ("HEARTBEAT", 255, True),
        ("HEARTBEAT", 245, True),
        ("SET_POSITION_TARGET_LOCAL_NED", 255, True),
        ("HEARTBEAT", 245, True),
        ("PING", 245, True),
    ]
    assert (parser.signing.goodsig_count, parser.signing.badsig_count) == (5, 0)
    assert {m._link_id for m in read} == {0}
    times = [int.from_bytes(m.get_msgbuf()[-12:-6], "little") for m in read]
    assert times == sorted(set(times))  # one clock for both kinds
    assert all(bytes(m.get_msgbuf()[-6:]) == digest(SECRET, bytes(m.get_msgbuf())) for m in read)
    wrong = verifier(OTHER)
    assert all(m.get_type() == "BAD_DATA" for data in link.transport.sent for m in wrong.parse_buffer(data))


def test_what_cannot_be_signed_does_not_leave(link):
    assert link.hear(heartbeat().pack(signer(timestamp=now_units())))
    version_1 = codec.heartbeat().pack(mav.MAVLink(None, 245, 190), force_mavlink1=True)
    unknown = bytearray(Encoder(245, 190).encode(codec.heartbeat()))
    unknown[7:10] = b"\xff\xff\xff"
    signed = heartbeat().pack(signer())
    for frame in (version_1, bytes(unknown), signed):
        assert not link.wire.send_raw(bytes(frame), 50.0)
    assert link.transport.sent == []
    assert link.wire.counters.refused == 3


def test_only_a_radios_own_state_may_come_unsigned(link):
    plain = mav.MAVLink(None, 1, 1)
    assert not link.hear(heartbeat().pack(plain))
    assert link.wire.vehicle is None
    assert link.hear(mav.MAVLink_radio_status_message(100, 100, 90, 20, 20, 0, 0).pack(mav.MAVLink(None, 51, 68)))
    for message in (
        codec.command(codec.VehicleId(1, 1, None), 400, 1.0),
        mav.MAVLink_current_mode_message(0, 6 << 16, 6 << 16),
        mav.MAVLink_command_ack_message(176, 0),
    ):
        assert not link.hear(message.pack(plain))
    assert link.signing.counts == {Verdict.UNSIGNED: 4, Verdict.ALLOWED: 1}
    forged = bytearray(mav.MAVLink_radio_status_message(1, 1, 1, 1, 1, 0, 0).pack(signer(OTHER, now_units(), 51, 68)))
    assert not link.hear(forged)  # unsigned is allowed, wrongly signed is not


def test_replayed_late_and_wrong_frames_are_dropped_by_kind(link):
    ours = signer(timestamp=now_units())
    first, second = heartbeat().pack(ours), heartbeat().pack(ours)
    assert link.hear(second)
    assert not link.hear(second)
    assert not link.hear(first)
    assert not link.hear(heartbeat().pack(signer(OTHER, now_units() + 100)))
    old = now_units() - 61 * UNITS_PER_S
    assert not link.hear(heartbeat().pack(signer(timestamp=old, component_id=9)))
    assert link.hear(heartbeat().pack(signer(timestamp=old + 2 * UNITS_PER_S, component_id=9)))
    assert link.signing.counts == {Verdict.SIGNED: 2, Verdict.REPLAYED: 2, Verdict.FORGED: 1, Verdict.OLD: 1}
    assert link.wire.figures(50.0).refused_frames == 4


def test_each_link_and_component_has_its_own_time(link):
    now = now_units()
    assert link.hear(heartbeat().pack(signer(timestamp=now + 1000, link=0)))
    assert link.hear(heartbeat().pack(signer(timestamp=now, link=1)))
    assert link.hear(heartbeat().pack(signer(timestamp=now, component_id=154)))


def test_a_forged_time_cannot_lock_the_vehicle_out(link):
    ours = signer(timestamp=now_units())
    assert link.hear(heartbeat().pack(ours))
    far = bytearray(heartbeat().pack(signer(timestamp=now_units() + 10**9)))
    far[-1] ^= 1
    assert not link.hear(far)
    assert link.hear(heartbeat().pack(ours))


def test_our_time_follows_a_vehicle_that_is_ahead(link):
    ahead = now_units() + 3600 * UNITS_PER_S
    assert link.hear(heartbeat().pack(signer(timestamp=ahead)))
    link.wire.send_heartbeat()
    assert int.from_bytes(link.transport.sent[-1][-12:-6], "little") == ahead + 1


def test_a_vehicle_whose_clock_is_behind_is_set_right_by_our_heartbeat(link):
    theirs = signer(timestamp=now_units() - 3600 * UNITS_PER_S)
    assert not link.hear(heartbeat().pack(theirs))
    link.wire.send_heartbeat()  # as wait_vehicle does meanwhile
    theirs.parse_buffer(link.transport.sent[-1])
    assert theirs.signing.goodsig_count == 1
    assert link.hear(heartbeat().pack(theirs))


def test_the_operator_is_told_once_in_ten_seconds(link, caplog):
    for _ in range(1000):
        link.hear(heartbeat().pack(mav.MAVLink(None, 1, 1)))
    assert [r.getMessage() for r in caplog.records] == ["refused on the link: 1 unsigned"]
    assert link.signing.alarm(50.0) == "refused on the link: 1 unsigned"
    link.clock.advance(10.1)
    assert link.signing.alarm(60.1) is None
    link.hear(heartbeat().pack(signer(OTHER)))
    assert link.signing.alarm(60.1) == "refused on the link: 999 unsigned, 1 wrong signature or key"
    assert SECRET.hex() not in caplog.text


def used(link) -> int:
    link.wire.send_heartbeat()
    return int.from_bytes(link.transport.sent[-1][-12:-6], "little")


def saved(link) -> None:
    """Five seconds are ahead of us in life; here the clock leaps, so wait for the disk."""
    if (saving := link.signing._times._saving) is not None:
        saving.join()


def test_a_restart_after_a_crash_repeats_no_time(tmp_path, monkeypatch):
    real = time.time()
    newest = 0
    for run in range(5):
        monkeypatch.setattr(time, "time", lambda run=run: real - 100 * run)  # and the clock goes back each time
        crashed = Link(tmp_path)
        for _ in range(20):
            time_used = used(crashed)
            assert time_used > newest
            newest = time_used
            crashed.clock.advance(1.7)
            saved(crashed)
        written = int((tmp_path / "signing.key.time").read_text().split()[0])
        assert newest < written <= newest + MARGIN


def test_an_orderly_end_keeps_exactly_what_was_used(tmp_path):
    first = Link(tmp_path)
    replay = heartbeat().pack(signer(timestamp=now_units()))
    assert first.hear(replay)
    last = used(first)
    first.signing.close()
    assert int((tmp_path / "signing.key.time").read_text().split()[0]) == last
    assert not Link(tmp_path).hear(replay)  # a restart does not make it new


def test_two_programs_with_one_key_never_lower_what_the_other_has_reserved(tmp_path):
    times = tmp_path / "signing.key.time"
    first, second = Link(tmp_path), Link(tmp_path)
    first.clock.advance(3600.0)
    newest = used(first)
    saved(first)
    second.signing.close()  # an hour behind
    assert int(times.read_text().split()[0]) > newest
    assert used(Link(tmp_path)) > newest


def test_damaged_or_unwritable_times_are_one_clear_error(tmp_path):
    Link(tmp_path)
    times = tmp_path / "signing.key.time"
    for text in ("", "x", "1 2", "-5", str(1 << 60), "5\n1 2 3\n"):
        times.write_text(text)
        with pytest.raises(Exception, match=r"signing\.key\.time: damaged"):
            Link(tmp_path)
    times.unlink()
    times.mkdir()
    with pytest.raises(Exception, match=r"signing\.key\.time: is a directory"):
        Link(tmp_path)


def test_a_full_disk_does_not_stop_the_sending(link, caplog, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gcs.signing_time._replace", full)
    for _ in range(10):
        link.clock.advance(10.0)
        assert link.wire.send_heartbeat() or link.wire.counters.unsent == 0
        saved(link)
    assert len(link.transport.sent) == 10
    (warning,) = caplog.records
    assert warning.getMessage().endswith("not kept any more: No space left on device")


def test_without_its_file_there_is_no_signing(tmp_path):
    with pytest.raises(KeyFileError, match="no such file"):
        Signing.open(tmp_path / "none", FakeClock())


def test_no_attack_is_believed_and_none_shuts_the_vehicle_out(tmp_path):
    """FORGED=100000 for the full run."""
    link, rng, kinds = Link(tmp_path), random.Random(11), Counter()
    ours, seen = signer(timestamp=now_units()), []
    for n in range(int(os.environ.get("FORGED", "20000"))):
        if n % 50 == 0:
            good = bytes(heartbeat().pack(ours))
            assert link.hear(good)
            seen.append(good)
        kind, frame = attack(rng, seen, ours.signing.timestamp + rng.randrange(1, 10**6))
        kinds[kind] += 1
        assert not link.hear(frame), (n, kind, frame.hex())
    assert len(link.believed) == len(seen)
    assert min(kinds.values()) > 2000
    refused = link.signing.counts
    assert all(refused[verdict] > 2000 for verdict in (Verdict.UNSIGNED, Verdict.FORGED, Verdict.REPLAYED, Verdict.OLD))


def test_an_unsigned_station_is_told_that_the_vehicle_signs(tmp_path):
    made = []
    wire = Wire.over(lambda received: made.append(Loopback(received)) or made[0], clock=FakeClock())
    made[0].received(bytes(heartbeat().pack(mav.MAVLink(None, 1, 1))), VEHICLE)
    assert security(wire.signing, wire.vehicle_signs) == "unsigned link"
    made[0].received(bytes(heartbeat().pack(signer())), VEHICLE)
    assert "give --signing-key" in security(wire.signing, wire.vehicle_signs)
