"""Puts a signing key on a vehicle with SETUP_SIGNING, and sees that it is used."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Final

from gcs import codec
from gcs.codec import VehicleId
from gcs.errors import VehicleError
from gcs.framing import Message, dialect
from gcs.keys import SigningKey
from gcs.signing import is_signed_with
from gcs.signing_time import EPOCH_UNIX_S, UNITS_PER_S
from gcs.wire import Wire

_TRIES: Final = 5
_RETRY_S: Final = 1.0


async def send_key(url: str, key: SigningKey, timeout_s: float, say: Callable[[str], None]) -> VehicleId:
    """Returns once the vehicle signs with this key; VehicleError if it does not. Never writes the key to a log."""
    wire = await Wire.open(url)
    signed = asyncio.Event()

    def look(message: Message, _t_s: float) -> None:
        ours = wire.vehicle is not None and codec.is_from(message, wire.vehicle)
        if ours and is_signed_with(message.get_msgbuf(), key):
            signed.set()

    wire.subscribe(look)
    try:
        say(f"waiting for a vehicle at {wire.url}")
        vehicle = await wire.wait_vehicle(timeout_s)
        for _ in range(_TRIES):
            wire.send_message(_setup(vehicle, key))
            try:
                await asyncio.wait_for(signed.wait(), _RETRY_S)
            except TimeoutError:
                continue
            return vehicle
        raise VehicleError(f"{vehicle} does not sign with the new key: it may have another one already, or cannot sign")
    finally:
        await wire.close()


def _setup(vehicle: VehicleId, key: SigningKey) -> Message:
    now = int((time.time() - EPOCH_UNIX_S) * UNITS_PER_S)
    return dialect.MAVLink_setup_signing_message(vehicle.system_id, vehicle.component_id, list(key.secret), max(now, 1))
