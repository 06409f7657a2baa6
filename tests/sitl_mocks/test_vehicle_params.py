"""The parameters of the factory, of a careful owner, and of the command line."""

from __future__ import annotations

import pytest

from sitl_mocks.__main__ import main
from sitl_mocks.vehicle import PREPARED, MockVehicle, Personality


@pytest.mark.parametrize("personality", Personality)
def test_a_prepared_vehicle_differs_from_the_factory_in_what_is_named(personality: Personality) -> None:
    factory, prepared = MockVehicle(personality), MockVehicle(personality, parameters=PREPARED[personality])
    changed = {name for name in factory.params.names() if factory.params[name] != prepared.params[name]}
    assert changed
    assert changed <= set(PREPARED[personality])
    assert all(prepared.params[name] == value for name, value in PREPARED[personality].items())


@pytest.mark.parametrize(("given", "said"), [("NOPE=1", "NOPE"), ("COM_OF_LOSS_T=nan", "COM_OF_LOSS_T"), ("X", "'X'")])
def test_a_bad_parameter_is_one_line_and_exit_2(given: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["--prepared", "--param", given])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    assert code == 2
    error = capsys.readouterr().err.splitlines()
    assert said in error[-1]
    assert "Traceback" not in "".join(error)
