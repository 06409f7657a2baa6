"""Signing on the vehicle's side: what it believes, what it sends, and what an impostor adds."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import Truth, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.core import UNIX_START_S
from sitl_mocks.vehicle.signing import Signing, timestamp_of

KEY, OTHER = bytes(range(32)), bytes(32)


def codec(key: bytes | None, link: int = 3, late_s: float = 0.0) -> Any:
    """A station's pymavlink, signing by the vehicle's wall clock."""
    made = mavlink.MAVLink(None, 255, 190)
    made.robust_parsing = True
    made.signing.secret_key, made.signing.sign_outgoing = key, key is not None
    made.signing.link_id, made.signing.timestamp = link, timestamp_of(UNIX_START_S - late_s)
    return made


def hold() -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129, 4, 5, 0, 0, 0, 0)


def vehicle(**other: Any) -> MockVehicle:
    made = MockVehicle(airborne_m=20.0, signing_key=KEY, **other)
    made.step(10.0)
    return made


@pytest.mark.parametrize(
    ("key", "late_s", "counted"),
    [(KEY, 0.0, "accepted"), (OTHER, 0.0, "forged"), (None, 0.0, "unsigned"), (KEY, 90.0, "replayed")],
    ids=["good", "wrong key", "unsigned", "old"],
)
def test_only_what_is_signed_with_the_key_and_fresh_is_obeyed(key: bytes | None, late_s: float, counted: str) -> None:
    mock = vehicle()
    mock.receive(bytes(hold().pack(codec(key, late_s=late_s))), 10.1)
    assert (mock.autopilot.mode is Mode.RETURN) is (counted == "accepted")
    counts = mock.signing.counts
    assert getattr(counts, counted) == 1
    assert counts.accepted + counts.dropped + counts.exempt == 1


def test_a_replay_is_turned_away_and_a_forgery_blocks_nobody() -> None:
    mock, station = vehicle(), codec(KEY)
    datagram = bytes(hold().pack(station))
    mock.receive(datagram, 10.1)
    mock.receive(datagram, 10.2)
    far = codec(OTHER)
    far.signing.timestamp += 10**9
    mock.receive(bytes(hold().pack(far)), 10.3)
    mock.receive(bytes(hold().pack(station)), 10.4)
    counts = mock.signing.counts
    assert (counts.accepted, counts.replayed, counts.forged) == (2, 1, 1)


def test_radio_status_needs_no_signature() -> None:
    mock = vehicle()
    mock.receive(bytes(mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1).pack(codec(None))), 10.1)
    assert (mock.signing.counts.exempt, mock.signing.counts.dropped) == (1, 0)


def test_what_it_sends_is_signed_fresh_and_readable_without_the_key() -> None:
    mock, station, monitor = vehicle(), codec(KEY), WireMonitor()
    seen = []
    for tick in range(1, 200):
        for datagram in mock.step(10.0 + tick * 0.01):
            seen += [m.get_type() for m in station.parse_buffer(datagram) or ()]
            monitor.feed(10.0 + tick * 0.01, datagram, Truth(False, False, False, (0.0, 0.0, 0.0)))
    assert len(seen) > 500
    assert "BAD_DATA" not in seen
    assert station.signing.goodsig_count == len(seen)
    assert monitor.broken == 0


def test_without_a_key_nothing_is_signed_and_everything_believed() -> None:
    mock = MockVehicle(airborne_m=20.0)
    datagrams = [datagram for tick in range(20) for datagram in mock.step(tick * 0.05)]
    assert all(not datagram[2] & 1 for datagram in datagrams)
    mock.receive(bytes(hold().pack(codec(OTHER))), 1.0)
    assert mock.autopilot.mode is Mode.RETURN


@pytest.mark.parametrize(
    ("fault", "counter"), [("replay_frac", "badsig_count"), ("forge_frac", "badsig_count"), ("unsigned_frac", None)]
)
def test_a_faulty_vehicle_replays_forges_and_forgets_to_sign(fault: str, counter: str | None) -> None:
    mock = vehicle()
    station = Signing(KEY, Personality.PX4).codec(255, 190)  # pymavlink's own lets a forgery move its time stamps
    setattr(mock.faults, fault, 0.5)
    good = bad = 0
    for tick in range(1, 300):
        for datagram in mock.step(10.0 + tick * 0.01):
            for message in station.parse_buffer(datagram) or ():
                good += message.get_type() != "BAD_DATA"
                bad += message.get_type() == "BAD_DATA"
    assert good > 300
    assert bad > 200
    if counter:
        assert getattr(station.signing, counter) > 100


def test_the_signing_outlives_a_reboot() -> None:
    mock, station = vehicle(), codec(KEY)
    mock.receive(bytes(hold().pack(station)), 10.1)
    for tick in range(1, 100):
        for datagram in mock.step(10.1 + tick * 0.01):
            station.parse_buffer(datagram)
    mock.reboot(12.0, silent_s=0.0)
    kinds = [m.get_type() for d in mock.step(12.1) + mock.step(13.2) for m in station.parse_buffer(d) or ()]
    assert "HEARTBEAT" in kinds
    assert "BAD_DATA" not in kinds


def test_a_bad_key_is_refused() -> None:
    with pytest.raises(ValueError, match="32 bytes"):
        MockVehicle(signing_key=b"short")


def test_a_key_is_set_up_on_the_ground_changed_only_by_who_has_it_and_switched_off_with_zeros() -> None:
    def setup(key: bytes, stamp: int) -> Any:
        return mavlink.MAVLink_setup_signing_message(1, 1, list(key), stamp)

    armed = MockVehicle(airborne_m=20.0)
    armed.receive(bytes(setup(KEY, 1).pack(codec(None))), 5.0)
    assert armed.signing.key is None
    mock = MockVehicle()
    mock.receive(bytes(setup(KEY, 1).pack(codec(None))), 5.0)
    assert mock.signing.key == KEY
    assert all(datagram[2] & 1 for datagram in mock.step(6.0))
    mock.receive(bytes(setup(OTHER, 1).pack(codec(None))), 6.0)
    assert mock.signing.key == KEY
    mock.receive(bytes(setup(bytes(32), 0).pack(codec(KEY))), 6.1)
    assert mock.signing.key is None
    assert not any(datagram[2] & 1 for datagram in mock.step(7.0))
