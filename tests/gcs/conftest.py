"""What several tests of the station need."""

from __future__ import annotations

import pytest

from gcs.wire import Wire
from tests.gcs.wire_peer import Peer, free_port, heartbeat


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
