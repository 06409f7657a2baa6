"""The audit of the vehicle's parameters: its table, its reader over a lossy link, its command and its refusals."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import sys
from collections.abc import AsyncIterator, Mapping
from pathlib import Path

import pytest

from gcs.audit import KNOWN, RULES, AuditError, Level, judge, known_name
from gcs.autopilot.parameters import ParameterReader, request
from gcs.autopilot.px4 import Px4
from gcs.codec import VehicleId
from gcs.config import load
from gcs.errors import ConfigError
from gcs.framing import Encoder
from gcs.operator.orders import Accept, parse_order
from gcs.wire import SYSTEM_ID, Wire
from sitl_mocks.vehicle import PREPARED, MockVehicle, Personality
from sitl_mocks.vehicle.params import Parameters
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.test_wire import FakeClock, free_port

BOTH = pytest.mark.parametrize("personality", list(Personality))
NAMES = {Personality.PX4: "PX4", Personality.ARDUPILOT: "ArduCopter"}
FACTORY_UNSAFE = {
    Personality.PX4: {"COM_OBL_RC_ACT", "COM_RC_OVERRIDE", "GF_MAX_HOR_DIST"},
    Personality.ARDUPILOT: {"GUID_TIMEOUT", "FS_GCS_ENABLE", "FENCE_ENABLE"},
}


def values_of(personality: Personality, changes: Mapping[str, float]) -> dict[str, float]:
    table = Parameters.defaults(personality, changes)
    return {name: table[name] for name in table.names()}


# -- the table ---------------------------------------------------------------------------------------------------


@BOTH
def test_the_factorys_parameters_are_refused_by_name_and_a_careful_owners_are_not(personality: Personality) -> None:
    factory = judge(NAMES[personality], values_of(personality, {}))
    assert {finding.name for finding in factory.refusing} == FACTORY_UNSAFE[personality]
    assert all(f"{name} is" in factory.problem for name in FACTORY_UNSAFE[personality])
    assert "\n" not in factory.problem
    careful = judge(NAMES[personality], values_of(personality, PREPARED[personality]))
    assert careful.ok
    assert careful.problem == ""
    accepted = judge(NAMES[personality], values_of(personality, {}), FACTORY_UNSAFE[personality])
    assert accepted.ok
    assert not judge(NAMES[personality], values_of(personality, {}), list(FACTORY_UNSAFE[personality])[1:]).ok


@pytest.mark.parametrize("autopilot", RULES)
def test_what_is_told_to_be_set_is_fine_and_nothing_read_is_unsafe(autopilot: str) -> None:
    values = {rule.names[0]: float(rule.set_to) for rule in RULES[autopilot]}
    assert {finding.level for finding in judge(autopilot, values).findings} == {Level.FINE}
    silent = judge(autopilot, {})
    assert "cannot be read" in silent.problem
    assert len(silent.refusing) >= 5
    for name in values:
        missing = {key: value for key, value in values.items() if key != name}
        worst = next(f.level for f in judge(autopilot, missing).findings if f.name == name)
        for value in (math.nan, math.inf, -math.inf):
            broken = judge(autopilot, values | {name: value})
            assert next(f for f in broken.findings if f.name == name).level is worst is not Level.FINE


@pytest.mark.parametrize(
    ("autopilot", "name", "level", "values"),
    [
        ("PX4", "COM_OF_LOSS_T", Level.FINE, (0.2, 0.5)),
        ("PX4", "COM_OF_LOSS_T", Level.ADVICE, (0.0, 0.1, 0.6, 1.0)),
        ("PX4", "COM_OF_LOSS_T", Level.UNSAFE, (-1.0, 1.01, 60.0)),
        ("PX4", "COM_OBL_RC_ACT", Level.ADVICE, (3, 4)),
        ("PX4", "COM_OBL_RC_ACT", Level.UNSAFE, (-1, 0, 1, 2, 6, 7)),
        ("PX4", "COM_RC_OVERRIDE", Level.FINE, (2, 3)),
        ("PX4", "COM_RC_OVERRIDE", Level.UNSAFE, (0, 1)),
        ("PX4", "GF_ACTION", Level.UNSAFE, (0, 1, 4)),
        ("PX4", "GF_MAX_HOR_DIST", Level.UNSAFE, (0.0, -5.0)),
        ("PX4", "GF_MAX_HOR_DIST", Level.ADVICE, (5000.0,)),
        ("PX4", "NAV_DLL_ACT", Level.ADVICE, (0, 1)),
        ("PX4", "NAV_DLL_ACT", Level.UNSAFE, (5, 6)),
        ("PX4", "COM_RCL_EXCEPT", Level.ADVICE, (4, 7)),
        ("ArduCopter", "GUID_TIMEOUT", Level.FINE, (0.5, 1.0)),
        ("ArduCopter", "GUID_TIMEOUT", Level.ADVICE, (0.1, 1.5, 2.0)),
        ("ArduCopter", "GUID_TIMEOUT", Level.UNSAFE, (0.0, 2.5, 3.0)),
        ("ArduCopter", "MAV_GCS_SYSID", Level.UNSAFE, (1, 245, 254)),
        ("ArduCopter", "FENCE_TYPE", Level.UNSAFE, (0, 1, 8)),
        ("ArduCopter", "FENCE_TYPE", Level.FINE, (2, 4, 7, 15)),
        ("ArduCopter", "FENCE_ACTION", Level.UNSAFE, (0,)),
        ("ArduCopter", "FLTMODE_CH", Level.UNSAFE, (0,)),
        ("ArduCopter", "RC_OPTIONS", Level.UNSAFE, (1, 33)),
        ("ArduCopter", "FS_OPTIONS", Level.ADVICE, (4, 20)),
    ],
)
def test_the_table(autopilot: str, name: str, level: Level, values: tuple[float, ...]) -> None:
    for value in values:
        audit = judge(autopilot, {name: float(value)})
        assert next(f.level for f in audit.findings if f.name == name) is level, value


def test_an_older_firmwares_name_does_as_well() -> None:
    def finding(values: dict[str, float], *accepted: str):  # type: ignore[no-untyped-def]
        return next(f for f in judge("ArduCopter", values, accepted).findings if "GCS" in f.name and "SYS" in f.name)

    assert finding({"SYSID_MYGCS": 255.0}).level is Level.FINE
    assert finding({"SYSID_MYGCS": 250.0}).name == "SYSID_MYGCS"
    assert finding({"SYSID_MYGCS": 250.0}).refuses
    assert not finding({"SYSID_MYGCS": 250.0}, "MAV_GCS_SYSID").refuses


def test_the_station_is_the_one_whose_heartbeats_count() -> None:
    rule = next(rule for rule in RULES["ArduCopter"] if "SYSID_MYGCS" in rule.names)
    assert rule.set_to == SYSTEM_ID


def test_only_names_of_the_audit_can_be_accepted(tmp_path: Path) -> None:
    assert known_name(" com_obl_rc_act ") == "COM_OBL_RC_ACT"
    with pytest.raises(AuditError, match="COM_OBL_RC_ACT"):
        known_name("COM_OBL_RC")
    assert parse_order("accept com_obl_rc_act") == Accept("COM_OBL_RC_ACT")
    path = tmp_path / "my.yaml"
    path.write_text("vehicle:\n  accept_parameters: [GF_ACTION, COM_RC_OVERRIDE]\n")
    assert load(path).vehicle.accept_parameters == ("GF_ACTION", "COM_RC_OVERRIDE")
    path.write_text("vehicle:\n  accept_parameters: [GF_ACTON]\n")
    with pytest.raises(ConfigError, match=r"my\.yaml:2: vehicle: accept_parameters: 'GF_ACTON' is none of"):
        load(path)


# -- the reader --------------------------------------------------------------------------------------------------


class Line:
    """A transport between a wire and a mock vehicle, in one process; what leaves is counted."""

    status, connections = "open", 1

    def __init__(self, received, vehicle: MockVehicle, clock: FakeClock) -> None:  # type: ignore[no-untyped-def]
        self.received, self._vehicle, self._clock = received, vehicle, clock
        self.sent = 0

    def send(self, data: bytes) -> bool:
        self.sent += 1
        for datagram in self._vehicle.receive(data, self._clock.now_s()):
            self.received(datagram, ("vehicle", 1))
        return True

    def run(self) -> None:
        for datagram in self._vehicle.step(self._clock.now_s()):
            self.received(datagram, ("vehicle", 1))

    def reply_to(self, peer: object) -> None:
        pass


class Bench:
    """A wire whose vehicle is heard, and a reader on it."""

    def __init__(self, personality: Personality, parameters: Mapping[str, float]) -> None:
        self.clock = FakeClock(10.0)
        self.vehicle = MockVehicle(personality, parameters=parameters)
        lines: list[Line] = []

        def factory(received):  # type: ignore[no-untyped-def]
            lines.append(Line(received, self.vehicle, self.clock))
            return lines[0]

        self.wire = Wire.over(factory, clock=self.clock)
        self.line = lines[0]
        self.pass_time(1.2)
        assert self.wire.vehicle is not None
        self.line.sent = 0

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.clock.advance(0.05)
            self.line.run()

    def read(self, names: list[tuple[str, ...]]) -> tuple[dict[str, float], float]:
        """Values, and how long it took (s)."""
        reader, start_s = ParameterReader(self.wire, names), self.clock.now_s()
        while not reader.poll(self.clock.now_s()):
            self.pass_time(0.05)
        reader.close()
        return reader.values, self.clock.now_s() - start_s


@BOTH
def test_every_parameter_is_read_in_its_autopilots_encoding(personality: Personality) -> None:
    bench = Bench(personality, PREPARED[personality])
    values, seconds = bench.read([rule.names for rule in RULES[NAMES[personality]]])
    assert judge(NAMES[personality], values).ok
    assert values == pytest.approx({name: bench.vehicle.params[name] for name in values})
    assert len(values) == len(RULES[NAMES[personality]])
    assert seconds < 0.3


def test_an_integer_that_looks_like_a_nan_is_read_as_it_is() -> None:
    for value in (-1, 0, 255, 65536, -(2**31)):
        bench = Bench(Personality.PX4, {"COM_RCL_EXCEPT": value})
        assert bench.read([("COM_RCL_EXCEPT",)])[0] == {"COM_RCL_EXCEPT": float(value)}


def test_half_the_datagrams_lost_cost_time_but_no_value() -> None:
    bench = Bench(Personality.PX4, {})
    bench.vehicle.faults.drop_uplink = bench.vehicle.faults.drop_downlink = 0.3
    names = [rule.names for rule in RULES["PX4"]]
    values, seconds = bench.read(names)
    assert bench.line.sent > len(names)  # some were lost
    assert len(values) == len(names)
    assert 0.4 < seconds < 3.5


def test_a_missing_name_ends_in_bounded_time_and_few_requests() -> None:
    bench = Bench(Personality.PX4, {})
    values, seconds = bench.read([("NO_SUCH",), ("GF_ACTION",)])
    assert values == {"GF_ACTION": 2.0}
    assert 2.5 <= seconds <= 3.5
    assert bench.line.sent == 7


def test_another_systems_parameters_are_not_believed() -> None:
    bench = Bench(Personality.PX4, {"GF_ACTION": 0})
    other = MockVehicle(Personality.PX4, parameters={"GF_ACTION": 2}, system_id=7)
    reader = ParameterReader(bench.wire, [("GF_ACTION",)])
    asked = Encoder(255, 191).encode(request(VehicleId(7, 1, Px4()), "GF_ACTION"))
    other.receive(asked, bench.clock.now_s())
    answers = other.step(bench.clock.now_s() + 0.05)
    assert any(b"GF_ACTION" in answer for answer in answers)
    for answer in answers:
        bench.line.received(answer, ("vehicle", 1))  # by the way of the pinned vehicle, as over a radio
    assert reader.values == {}
    bench.vehicle.faults.drop_uplink = 0.0
    reader.poll(bench.clock.now_s())
    bench.pass_time(0.1)
    assert reader.values == {"GF_ACTION": 0.0}


# -- the command -------------------------------------------------------------------------------------------------


@contextlib.asynccontextmanager
async def vehicle_at(personality: Personality, parameters: Mapping[str, float]) -> AsyncIterator[str]:
    port = free_port()
    flying = asyncio.create_task(run_udp(MockVehicle(personality, parameters=parameters), ("127.0.0.1", port)))
    try:
        yield f"udpin://127.0.0.1:{port}"
    finally:
        flying.cancel()
        await asyncio.gather(flying, return_exceptions=True)


async def gcs(*arguments: str) -> tuple[int, str, str]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


@BOTH
async def test_the_command_says_what_to_set(personality: Personality) -> None:
    async with vehicle_at(personality, {}) as url:
        status, said, _ = await gcs("audit", "--vehicle", url)
        assert status == 1
        for name in FACTORY_UNSAFE[personality]:
            assert f"  param set {name} " in said
        accept = [word for name in FACTORY_UNSAFE[personality] for word in ("--accept", name.lower())]
        status, said, _ = await gcs("audit", "--vehicle", url, "--json", *accept)
        assert status == 0
        rows = json.loads(said)["parameters"]
        assert {row["name"] for row in rows if row["accepted"]} == FACTORY_UNSAFE[personality]


async def test_a_careful_owner_is_told_so_and_misuse_is_one_line() -> None:
    async with vehicle_at(Personality.PX4, PREPARED[Personality.PX4]) as url:
        status, said, _ = await gcs("audit", "--vehicle", url)
        assert (status, said.splitlines()[0]) == (0, "PX4: a follow may start")
        status, said, errors = await gcs("audit", "--vehicle", url, "--accept", "NO_SUCH")
        assert (status, said) == (2, "")
        assert "'NO_SUCH' is no parameter of the audit" in errors
    status, _, errors = await gcs("audit", "--vehicle", f"udpin://127.0.0.1:{free_port()}", "--timeout", "0.3")
    assert status == 2
    assert "no vehicle at" in errors


def test_every_name_fits_into_a_request() -> None:
    assert all(len(name) <= 16 and name.isascii() for name in KNOWN)
