"""A flight whose vehicle has unsafe parameters: refused by name, accepted by name; over UDP, MAVSDK beside us."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gcs.audit import AuditError
from gcs.config import RecorderConfig
from gcs.flight_orders import RefusedError
from gcs.operator.orders import Accept, Confirm, parse_order
from gcs.recorder.flight_recorder import MESSAGES, FlightRecorder
from gcs.recorder.message_log import read_messages
from sitl_mocks.vehicle import Personality
from tests.gcs.test_audit import BOTH, FACTORY_UNSAFE
from tests.gcs.test_flight_integration import session


async def audited(s) -> None:  # type: ignore[no-untyped-def]
    async with asyncio.timeout(5.0):
        while s.flight.auditor.audit is None:
            await asyncio.sleep(0.02)


@BOTH
async def test_factory_parameters_refuse_to_follow_until_each_is_accepted_by_name(personality: Personality) -> None:
    async with session(personality.value, parameters={}) as s:
        with pytest.raises(RefusedError) as error:
            await s.begin()
        for name in FACTORY_UNSAFE[personality]:
            assert f"{name} is" in str(error.value)
            assert any(line.startswith(f"unsafe: {name} is") for line in s.said)
        assert s.monitor.setpoints == 0
        with pytest.raises(AuditError):
            await s.orders.perform(parse_order("accept NO_SUCH"))
        *others, last = sorted(FACTORY_UNSAFE[personality])
        for name in others:
            await s.orders.perform(parse_order(f"accept {name}"))
        with pytest.raises(RefusedError) as error:
            await s.orders.perform(Confirm())
        assert f"{last} is" in str(error.value)
        assert not any(name in str(error.value) for name in others)
        await s.orders.perform(Accept(last))
        assert "confirmed" in await s.confirm()
        assert s.monitor.summary()["unsafe"] == 0, s.monitor.summary()["reasons"]
        assert s.mock.params["COM_OBL_RC_ACT" if personality is Personality.PX4 else "FENCE_ENABLE"] == 0  # never set


async def test_a_configuration_accepts_by_name() -> None:
    async with session("px4", parameters={}, accepted=tuple(FACTORY_UNSAFE[Personality.PX4])) as s:
        await audited(s)
        assert s.flight.auditor.ok
        assert any(line.startswith("accepted: GF_MAX_HOR_DIST is 0") for line in s.said)


async def test_a_vehicle_that_was_away_is_audited_again(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, RecorderConfig())
    async with session("px4") as s:
        s.flight.watchers = (recorder,)
        await audited(s)
        assert s.flight.auditor.ok
        s.mock.params["COM_OBL_RC_ACT"] = 0
        s.mock.faults.drop_downlink = 1.0
        await asyncio.sleep(3.3)
        s.mock.faults.drop_downlink = 0.0
        async with asyncio.timeout(8.0):
            while not s.flight.auditor.problem.startswith("unsafe vehicle parameters: COM_OBL_RC_ACT is 0"):
                await asyncio.sleep(0.02)
        assert s.flight.link.telemetry.reconnects >= 1
        assert not s.flight.auditor.ok
        assert not (await s.flight.next_tick()).inputs.audit_ok
    assert recorder.close() == []
    audits = [record.data for record in read_messages(tmp_path / MESSAGES) if record.type == "Audit"]
    assert audits[-1]["findings"][1]["value"] == 0.0
