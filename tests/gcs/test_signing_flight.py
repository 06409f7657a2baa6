"""A signed link in flight: MAVSDK, our own setpoints and a mock vehicle whose signing is pymavlink's."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

from control.types import VehicleMode
from gcs.errors import VehicleError
from gcs.flight_view import link_summary, link_warnings
from gcs.key_transfer import send_key
from gcs.keys import SigningKey, read_key, write_key
from gcs.signing import Signing, Verdict
from gcs.wire import Wire
from sitl_mocks.vehicle import MockVehicle, Mode
from sitl_mocks.vehicle.core import UNIX_START_S
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.signing_peer import OTHER, SECRET, signer
from tests.gcs.vehicle_session import BOTH, CLOCK, session
from tests.gcs.wire_peer import Peer, eventually, free_port, heartbeat


@pytest.fixture
def signing(tmp_path):
    write_key(tmp_path / "signing.key", SigningKey(SECRET))
    return Signing.open(tmp_path / "signing.key", CLOCK)


@BOTH
async def test_mavsdk_and_our_setpoints_fly_a_vehicle_that_wants_signatures(personality, signing):
    behind = {"unix_start_s": UNIX_START_S}
    async with session(personality, signing=signing, signing_key=SECRET, airborne_m=10.0, **behind) as s:
        assert signing.counts[Verdict.OLD] > 0  # its clock is behind ours; our first heartbeat set it right
        await s.telemetry.wait_for(lambda st: st.position_t_s is not None, 5.0)
        name = "COM_OF_LOSS_T" if personality == "px4" else "GUID_TIMEOUT"
        assert await s.actions.get_param(name) == pytest.approx(s.mock.params[name])
        s.start_stream()
        await asyncio.sleep(0.3)
        await s.modes.enter_external()
        s.velocity = (1.5, 0.0, 0.0)
        assert await s.telemetry.wait_for(lambda st: st.velocity_ned_mps[0] > 1.0, 6.0), s.reasons
        await s.actions.hold()  # MAVSDK's own command, made unsigned and signed by us
        await s.reached(VehicleMode.HOLD)
        await s.stop_stream()
        counts = s.mock.signing.counts
        assert counts.accepted > 30
        assert counts.forged == counts.unsigned == counts.exempt == 0
        assert s.wire.counters.refused == 0
        assert set(signing.counts) == {Verdict.SIGNED, Verdict.OLD}


async def test_what_an_impostor_sends_along_changes_nothing(signing):
    async with session("px4", signing=signing, signing_key=SECRET, airborne_m=10.0) as s:
        faults = s.mock.faults
        faults.forge_frac = faults.replay_frac = 0.5
        believed = []
        s.wire.subscribe(lambda message, t_s: believed.append(message))
        await eventually(
            lambda: min(signing.counts[v] for v in (Verdict.UNSIGNED, Verdict.FORGED, Verdict.REPLAYED)) > 30
        )
        assert all(message.get_msgbuf()[2] & 1 for message in believed)
        assert s.telemetry.vehicle_state().mode is VehicleMode.HOLD
        assert s.mock.autopilot.mode is Mode.HOLD
        assert signing.alarm(CLOCK.now_s()) in link_warnings(s.wire, s.telemetry, CLOCK.now_s())
        assert link_summary(s.wire, CLOCK.now_s()).endswith("kB/s, signed link")
        s.start_stream()
        await asyncio.sleep(0.3)
        await s.modes.enter_external()  # and flying goes on
        await s.stop_stream()


@pytest.mark.parametrize("theirs", [None, OTHER])
async def test_a_vehicle_without_our_key_is_one_clear_error(signing, theirs):
    port, mock = free_port(), MockVehicle("px4", signing_key=theirs)
    wire = await Wire.open(f"udpin://127.0.0.1:{port}", signing=signing)
    flying = asyncio.create_task(run_udp(mock, ("127.0.0.1", port)))
    try:
        with pytest.raises(VehicleError, match="its signature is missing or wrong"):
            await wire.wait_vehicle(0.7)
        assert wire.vehicle is None
    finally:
        flying.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await flying
        await wire.close()


class KeyTaker:
    """A vehicle that does what SETUP_SIGNING says, or not."""

    def __init__(self, port: int, obeys: bool) -> None:
        self.peer = Peer(port)
        self.obeys = obeys
        self.secret: bytes | None = None

    async def run(self) -> None:
        while True:
            for message in self.peer.received():
                if message.get_type() == "SETUP_SIGNING" and self.obeys:
                    self.secret = bytes(message.secret_key)
                    self.peer.mav = signer(self.secret, message.initial_timestamp)
            self.peer.send(heartbeat())
            await asyncio.sleep(0.05)


@pytest.mark.parametrize("obeys", [True, False])
async def test_a_key_is_put_on_a_vehicle_and_seen_to_be_used(tmp_path, monkeypatch, obeys):
    monkeypatch.setattr("gcs.key_transfer._RETRY_S", 0.3)
    path, said = tmp_path / "new.key", []
    write_key(path, SigningKey.random())
    port = free_port()
    vehicle = KeyTaker(port, obeys)
    running = asyncio.create_task(vehicle.run())
    try:
        sending = send_key(f"udpin://127.0.0.1:{port}", read_key(path), 5.0, said.append)
        if obeys:
            assert str(await sending) == "PX4 (system 1)"
            assert vehicle.secret == read_key(path).secret
        else:
            with pytest.raises(VehicleError, match="does not sign with the new key"):
                await sending
        assert read_key(path).secret.hex() not in "".join(said)
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
        vehicle.peer.close()
