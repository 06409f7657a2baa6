"""Whatever the bytes: the mock vehicle and the judge neither break nor count what is not there."""

from __future__ import annotations

import math
import random

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import Truth, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Personality

HANDLED = (0, 4, 11, 20, 21, 23, 69, 70, 75, 76, 82, 84, 86, 111)
FLYING = Truth(external=True, armed=True, in_air=True, position_ned_m=(0.0, 0.0, -10.0))


def frame(rng: random.Random, number: int) -> bytes:
    """A frame with a right checksum and any payload."""
    kind = mavlink.mavlink_map[number]
    payload = rng.randbytes(kind.unpacker.size)
    if rng.random() < 0.5 and all(length == 1 for length in kind.lengths):
        fields = list(kind.unpacker.unpack(payload))
        for at, name in enumerate(kind.ordered_fieldnames):
            if name in ("target_system", "target_component", "target"):
                fields[at] = 1
        payload = kind.unpacker.pack(*fields)
    header = bytes([len(payload), 0, 0, rng.randrange(256), 255, 190]) + number.to_bytes(3, "little")
    checksum = mavlink.x25crc(header + payload)
    checksum.accumulate(bytes([kind.crc_extra]))
    return b"\xfd" + header + payload + checksum.crc.to_bytes(2, "little")


@pytest.mark.parametrize("personality", Personality)
@pytest.mark.parametrize("airborne_m", [None, 20.0])
def test_any_payload_of_any_message_is_survived(personality: Personality, airborne_m: float | None) -> None:
    rng = random.Random(7)
    vehicle, monitor = MockVehicle(personality, airborne_m=airborne_m), WireMonitor()
    answered = 0
    for tick in range(1500):
        now_s = 5.0 + tick * 0.01
        data = frame(rng, rng.choice(HANDLED))
        if rng.random() < 0.3:
            spoiled = bytearray(data)
            spoiled[rng.randrange(len(spoiled))] ^= 1 << rng.randrange(8)
            data = bytes(spoiled)
        monitor.feed(now_s, data, vehicle.truth())
        answered += len(vehicle.receive(data, now_s))
        vehicle.step(now_s)
    assert answered > 0
    assert all(map(math.isfinite, (vehicle.params[name] for name in vehicle.params.names())))
    assert monitor.broken > 20


def test_noise_is_no_setpoint() -> None:
    rng, monitor = random.Random(3), WireMonitor()
    for tick in range(3000):
        monitor.feed(5.0 + tick * 0.01, rng.randbytes(rng.randrange(80)), FLYING)
    assert monitor.setpoints == 0
    assert not monitor.counts
