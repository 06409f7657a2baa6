"""What several tests of the station need."""

from __future__ import annotations

import pytest

from gcs.clock import FakeClock
from gcs.telemetry import Telemetry
from gcs.wire import Wire
from tests.gcs.recording_wire import RecordingWire
from tests.gcs.wire_peer import Peer, free_port, heartbeat


@pytest.fixture
def clock():
    return FakeClock(100.0)


@pytest.fixture
def wire(clock):
    return RecordingWire(clock)


@pytest.fixture
def telemetry(wire, clock):
    return Telemetry(wire, clock)


@pytest.fixture
async def link():
    """A wire with a vehicle already pinned, and the vehicle's end."""
    port = free_port()
    wire = await Wire.open(f"udpin://127.0.0.1:{port}")
    peer = Peer(port)
    peer.send(heartbeat())
    await wire.wait_vehicle(5.0)
    yield wire, peer
    await wire.close()
    peer.close()
