"""What several checks do first: select, stop, read and set parameters."""

from __future__ import annotations

from typing import Any

from tests.conformance.client import ACCEPTED, RESULTS, Client, mavlink

BOX = (0.40, 0.40, 0.60, 0.65)


async def selected(client: Client) -> Any:
    """Something is tracked; its status."""
    await fresh(client)
    result = await client.command(2005, *BOX)
    assert result == ACCEPTED, f"TRACK_RECTANGLE: {RESULTS[result]}"
    status = await client.tracking(lambda m: m.tracking_status & 1)
    assert status.tracking_mode == 2
    assert status.target_data & 4, "target_data lacks IN_STATUS"
    assert 0 <= status.rec_top_x < status.rec_bottom_x <= 1
    assert 0 <= status.rec_top_y < status.rec_bottom_y <= 1
    return status


async def stop(client: Client) -> None:
    """Nothing is tracked, and no status is sent."""
    assert await client.command(2010) == ACCEPTED
    assert await client.command(511, 275, -1) == ACCEPTED


async def fresh(client: Client) -> None:
    """Nothing is tracked, and the status comes at 20 Hz."""
    await stop(client)
    assert await client.command(511, 275, 50_000) == ACCEPTED


async def read_parameters(client: Client) -> list[Any]:
    """PARAM_EXT_VALUE of all, by index; empty where there are none."""
    assert client.camera is not None
    since = len(client.heard)
    client.send(mavlink.MAVLink_param_ext_request_list_message(*client.camera))
    try:
        first = await client.wait("PARAM_EXT_VALUE", since=since, timeout_s=1.0)
    except AssertionError:
        return []
    found = {}
    for index in range(first.param_count):
        found[index] = await client.wait("PARAM_EXT_VALUE", lambda m, at=index: m.param_index == at, since)
    assert len({m.param_id for m in found.values()}) == first.param_count
    return list(found.values())


async def set_parameter(client: Client, name: str, value: bytes, kind: int) -> Any:
    """Its PARAM_EXT_ACK, the last one where others said that it was under way."""
    assert client.camera is not None
    since = len(client.heard)
    client.send(mavlink.MAVLink_param_ext_set_message(*client.camera, name.encode(), value, kind))
    return await client.wait("PARAM_EXT_ACK", lambda m: m.param_id == name and m.param_result != 3, since)
