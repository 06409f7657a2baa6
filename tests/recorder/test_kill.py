"""Five SIGKILLs at random moments of real flights; `python -m tests.recorder.kill` does a hundred."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recorder.kill import LOST_S, kill_one

pytestmark = pytest.mark.alone  # real flights in real time want the machine to themselves


@pytest.mark.parametrize("seed", range(5))
async def test_a_killed_flight_opens_up_to_its_last_second(
    tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    loss = await kill_one(seed, tmp_path / "flight")
    assert loss.worst_s <= LOST_S
