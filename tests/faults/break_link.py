"""Faults of the connection and of who else is on it: H10 to H13, H28 to H32."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import development as mavlink

from gcs.lockstep.world import DELAY_S, UNIX_S, VEHICLE_PEER, Setup
from sitl_mocks.link_faults import Conditions, OneWay
from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.signing import timestamp_of
from sitl_mocks.vehicle.streams import (
    ATTITUDE,
    CURRENT_MODE,
    GLOBAL_POSITION_INT,
    HEARTBEAT,
    LOCAL_POSITION_NED,
)
from tests.faults.break_vehicle import once_external
from tests.faults.script import Happened
from tests.faults.world import FaultWorld

_HEARTBEAT_S = 3.1
_STRANGER = ("stranger", 14555)


def _lost_more(way: OneWay, least: int) -> Happened:
    before = way.counts.lost
    return lambda: way.counts.lost - before >= least


def _close(way: OneWay) -> Happened:
    way.conditions = replace(way.conditions, closed=True)
    return _lost_more(way, 1)


def link_down(world: FaultWorld) -> Happened:
    """Nothing passes either way."""
    down, up = _close(world.down), _close(world.up)
    return lambda: down() and up()


def uplink_down(world: FaultWorld) -> Happened:
    """We hear it, it does not hear us."""
    return _close(world.up)


def downlink_down(world: FaultWorld) -> Happened:
    """It hears us, we do not hear it."""
    return _close(world.down)


def make_bad(world: FaultWorld, conditions: Conditions) -> Happened:
    """From now on the link is like that, both ways, and the judge at the vehicle knows."""
    delay_s = conditions.delay_s
    world.up.conditions = world.down.conditions = conditions
    # A setpoint is as old as the link makes it, and steps between setpoints are judged where they leave. A delay that
    # grows by more than COM_OF_LOSS_T starves PX4, and what was under way then takes it back into OFFBOARD by itself;
    # that nothing moves it any more without the operator is judged where it leaves, too.
    limits = world.monitor.limits
    world.monitor.limits = replace(
        limits,
        mode_grace_s=limits.mode_grace_s + 2.5 * delay_s,
        accel_max_mps2=math.inf,
        yaw_accel_max_rps2=math.inf,
        confirmation_needed=delay_s < 0.25,
    )
    return _lost_more(world.down, 3)


def link_bad(world: FaultWorld) -> Happened:
    """Loss, delay, jitter, duplicates and overtaking, both ways."""
    loss, delay_s = world.random.choice((0.05, 0.2, 0.5)), world.random.choice((0.0, 0.1, 0.25, 0.5, 1.0))
    lost = make_bad(world, Conditions(loss, DELAY_S + delay_s, 0.1 * delay_s, 0.05, 0.05))
    return lambda: lost() and world.down.counts.duplicated > 0 and world.down.counts.reordered > 0


def _stop(world: FaultWorld, *streams: int) -> Happened:
    world.vehicle.faults.stopped_streams.update(streams)
    times = [world.vehicle.streams.interval_s(stream) for stream in streams]
    return lambda: any(interval_s is not None for interval_s in times)


def attitude_stops(world: FaultWorld) -> Happened:
    """ATTITUDE comes no more."""
    return _stop(world, ATTITUDE)


def position_stops(world: FaultWorld) -> Happened:
    """LOCAL_POSITION_NED comes no more."""
    return _stop(world, LOCAL_POSITION_NED)


def height_stops(world: FaultWorld) -> Happened:
    """GLOBAL_POSITION_INT, which tells the height above home, comes no more."""
    return _stop(world, GLOBAL_POSITION_INT)


def heartbeat_stops(world: FaultWorld) -> Happened:
    """HEARTBEAT and CURRENT_MODE come no more; until T_hb it cannot be known who has the vehicle."""
    world.monitor.limits = replace(world.monitor.limits, mode_grace_s=_HEARTBEAT_S)
    return _stop(world, HEARTBEAT, CURRENT_MODE)


def _packer(system_id: int) -> mavlink.MAVLink:
    return mavlink.MAVLink(None, system_id, 190)


def _repeat(world: FaultWorld, period_s: float, act: object) -> list[float]:
    """Call `act()` so often from now on; the list of the times it was."""
    times: list[float] = []
    state = [world.loop.time()]

    def hook(now_s: float) -> None:
        if now_s >= state[0]:
            state[0] += period_s * world.random.uniform(0.8, 1.2)  # no two clocks run alike
            times.append(now_s)
            act()  # type: ignore[operator]

    world.hooks.append(hook)
    return times


def foreign_setpoints(world: FaultWorld) -> Happened:
    """Another station steers as well, the vehicle obeys both in turns."""
    ours = world.exit.velocity_ned_mps  # he steers elsewhere: where both agree nobody can tell, nor needs to
    heading = math.atan2(ours[1], ours[0]) + world.random.uniform(1.0, 2 * math.pi - 1.0)
    packer = _packer(254)
    north, east = 3.0 * math.cos(heading), 3.0 * math.sin(heading)
    obeyed: list[bool] = []

    def send() -> None:
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x5C7, 0, 0, 0, north, east, 0, 0, 0, 0, 0, 0
        )
        world.vehicle.receive(message.pack(packer), world.loop.time())
        setpoint = world.vehicle.autopilot.flight.setpoint
        obeyed.append(setpoint is not None and abs(setpoint.velocity_ned_mps[0] - north) < 1e-3)

    _repeat(world, 0.05, send)
    return lambda: len(obeyed) > 10


def foreign_heartbeats(world: FaultWorld) -> Happened:
    """Another station is there and only listens."""
    packer = _packer(254)
    times = _repeat(world, 1.0, lambda: world.inject(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(packer)))
    return lambda: len(times) > 1 and (254, 190) in world.telemetry.foreign_stations


def foreign_command(world: FaultWorld) -> Happened:
    """Another station changes the mode by a command."""
    mode = world.random.choice((Mode.LAND, Mode.RETURN))
    if world.px4:
        numbers = (4.0, 6.0 if mode is Mode.LAND else 5.0)
    else:
        numbers = (9.0 if mode is Mode.LAND else 6.0, 0.0)
    data = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129.0, *numbers, 0, 0, 0, 0).pack(_packer(254))
    modes = once_external(world, lambda: world.down_from_vehicle(world.vehicle.receive(data, world.loop.time())))
    return lambda: mode in modes


def second_vehicle(world: FaultWorld) -> Happened:
    """A second vehicle, in another mode and elsewhere, speaks on the same port."""
    kind = Personality.ARDUPILOT if world.px4 else Personality.PX4
    other = MockVehicle(
        kind, system_id=2, airborne_m=40.0, rates_hz={HEARTBEAT: 1.0, ATTITUDE: 20.0, 32: 20.0, 33: 10.0}
    )
    peer = world.random.choice((VEHICLE_PEER, _STRANGER))
    count = [0]

    def hook(now_s: float) -> None:
        for data in other.step(now_s):
            count[0] += 1
            world.inject(data, peer)

    world.hooks.append(hook)
    return lambda: count[0] > 50 and other.autopilot.mode is not Mode.EXTERNAL


def signed(setup: Setup) -> Setup:
    """Both ends share a key."""
    return replace(setup, signed=True)


def _lie(world: FaultWorld, lie: Callable[[], bytes]) -> Happened:
    """The pilot takes over, and from then on somebody says in the vehicle's name that we still have it."""
    modes = once_external(world, lambda: world.vehicle.pilot_sets_mode(Mode.LAND))
    peer = world.random.choice((VEHICLE_PEER, _STRANGER))
    world.loop.call_later(0.3, lambda: _repeat(world, 0.2, lambda: world.inject(lie(), peer)))
    wire = world.wire
    assert wire.signing is not None
    signing, dropped = wire.signing, wire.signing.refused + wire.counters.foreign_datagrams

    def happened() -> bool:
        told = signing.refused + wire.counters.foreign_datagrams - dropped
        return told > 5 and Mode.LAND in modes

    return happened


def forged_mode(world: FaultWorld) -> Happened:
    """Made up by somebody without a key."""
    forger = mavlink.MAVLink(None, 1, 1)
    kind, number = (12, 6 << 16) if world.px4 else (3, 4)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, kind, 0x91, number, 4, 3)
    return _lie(world, lambda: heartbeat.pack(forger))


def replayed_mode(world: FaultWorld) -> Happened:
    """Recorded while we had it."""
    forger = mavlink.MAVLink(None, 1, 1)
    if world.setup.signed:
        forger.signing.secret_key, forger.signing.sign_outgoing = world.vehicle.signing.key, True
    heard = world.vehicle.message(HEARTBEAT, world.loop.time())
    kind, number = (12, 6 << 16) if world.px4 else (3, 4)
    heard.autopilot, heard.custom_mode = kind, number
    forger.signing.timestamp = timestamp_of(UNIX_S + world.loop.time() - 100.0 - 1.0)
    recording = heard.pack(forger)
    return _lie(world, lambda: recording)


def garbage(world: FaultWorld) -> Happened:
    """Damaged frames and noise among the good ones."""
    rng = world.random
    sent = [0]

    def send() -> None:
        data = bytearray(world.vehicle.message(ATTITUDE, world.loop.time()).pack(_packer(1)))
        for _ in range(rng.randint(1, 6)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        noise = rng.randbytes(rng.randrange(300))
        world.inject(rng.choice((bytes(data), noise, noise + bytes(data), bytes(data[: rng.randrange(len(data))]))))
        sent[0] += 1

    _repeat(world, 0.02, send)
    before = world.wire.frames.bad
    return lambda: sent[0] > 50 and world.wire.frames.bad - before > 20
