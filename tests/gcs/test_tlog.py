"""The telemetry log: both directions, never in the way."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs import codec
from gcs.framing import Encoder
from gcs.recorder.tlog import TlogWriter
from gcs.wire import Wire
from tests.gcs.wire_peer import Peer, eventually, free_port, got, heartbeat, setpoint


async def test_tlog_of_both_directions_opens_in_pymavlink(tmp_path, monkeypatch):
    monkeypatch.setenv("MAVLINK20", "1")
    path, port = tmp_path / "flight.tlog", free_port()
    tlog = TlogWriter(path)
    wire, peer = await Wire.open(f"udpin://127.0.0.1:{port}", tlog=tlog), Peer(port)
    wall_s = time.time()
    peer.send(heartbeat())
    await wire.wait_vehicle(5.0)
    peer.send_bytes(b"garbage is not logged")
    wire.send_setpoint(setpoint(time.monotonic()))
    raw = Encoder(245, 190).encode(codec.heartbeat())
    wire.send_raw(raw, time.monotonic())
    wire.send_raw(raw, time.monotonic() - 1.0)  # stale: has not left, is not logged
    await wire.close()
    tlog.close()
    peer.close()
    log = mavutil.mavlink_connection(str(path), dialect="development")
    read = []
    while (message := log.recv_msg()) is not None:
        read.append(message)
    log.close()
    assert [(m.get_type(), m.get_srcSystem()) for m in read] == [
        ("HEARTBEAT", 1),
        ("SET_POSITION_TARGET_LOCAL_NED", 255),
        ("HEARTBEAT", 245),
    ]
    assert all(abs(m._timestamp - wall_s) < 60 for m in read)


def test_tlog_never_overwrites(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"an earlier flight")
    tlog = TlogWriter(path)
    tlog.write(b"frame", 0.0)
    tlog.close()
    assert tlog.problem == f"{path}: file exists"
    assert path.read_bytes() == b"an earlier flight"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full (Linux)")
async def test_full_disk_ends_the_log_and_not_the_flight(link, caplog):
    wire, peer = link
    wire._tlog = tlog = TlogWriter(Path("/dev/full"), open_file=lambda path: path.open("wb", buffering=0))
    for _ in range(3):
        assert wire.send_heartbeat()
    await got(peer, "HEARTBEAT")
    await eventually(lambda: tlog.problem is not None)
    tlog.close()
    assert tlog.dropped == 3
    (record,) = caplog.records
    assert record.getMessage() == "the record ends here: /dev/full: no space left on device"
