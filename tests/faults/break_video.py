"""Faults of the picture, the tracker and the target: H1 to H9, H20, H33, H39."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs.lockstep.eyes import HEIGHT_PX, WIDTH_PX
from tests.faults.script import Happened
from tests.faults.world import FaultWorld
from tracker.box import Box

_TELLING_RAD = 0.15


def _more(world: FaultWorld, counter: str, least: int) -> Happened:
    before = getattr(world.eyes, counter)
    return lambda: getattr(world.eyes, counter) - before >= least


def _after_those_under_way(world: FaultWorld) -> None:
    """The fault counts from the last good picture."""
    under_way_s = world.eyes.glass_s + world.eyes.track_s
    world.loop.call_later(under_way_s, lambda: world.caused(world.loop.time()))


def video_lost(world: FaultWorld) -> Happened:
    """No picture comes any more, not even those under way."""
    delivered = world.eyes.delivered
    world.eyes.running = False
    return lambda: world.eyes.delivered == delivered


def video_still(world: FaultWorld) -> Happened:
    """The same picture again and again, under new times."""
    pictures, delivered = world.eyes.pictures, world.eyes.delivered
    world.eyes.still = True
    return lambda: world.eyes.pictures == pictures and world.eyes.delivered > delivered + 10


def pictures_old(world: FaultWorld) -> Happened:
    """A buffer somewhere has filled up: every picture half a second to two seconds old."""
    world.eyes.buffered_s = world.random.uniform(0.5, 2.0)
    _after_those_under_way(world)
    return _more(world, "delivered", 5)


def drift_away(world: FaultWorld) -> Happened:
    """The tracker slides over to something else that passes by; no rule can see that at once."""
    start_s, side = world.loop.time(), world.random.choice((-1.0, 1.0))
    shifts: list[float] = []

    def slide(box: Box, now_s: float) -> Box:
        shifts.append(min(60.0 * (now_s - start_s), 200.0))
        return replace(box, cx_px=box.cx_px + side * shifts[-1])

    world.eyes.distort = slide
    return lambda: bool(shifts) and shifts[-1] > 30.0


def box_jumps_back(world: FaultWorld) -> Happened:
    """Every fourth box sits somewhere else."""
    jump = world.random.choice((-1.0, 1.0)) * world.random.uniform(150.0, 280.0)
    boxes: list[float] = []

    def move(box: Box, now_s: float) -> Box:
        boxes.append(now_s)
        return replace(box, cx_px=box.cx_px + jump) if len(boxes) % 4 == 0 else box

    world.eyes.distort = move
    return lambda: len(boxes) > 8


def box_jumps(world: FaultWorld) -> Happened:
    """The box sits on something else from one picture to the next."""
    jump = world.random.choice((-1.0, 1.0)) * world.random.uniform(150.0, 280.0)
    jumps: list[float] = []

    def move(box: Box, now_s: float) -> Box:
        jumps.append(now_s)
        return replace(box, cx_px=min(max(box.cx_px + jump, 5.0), WIDTH_PX - 5.0))

    world.eyes.distort = move
    return lambda: len(jumps) > 5


def box_absurd(world: FaultWorld) -> Happened:
    """Boxes and scores that are no numbers, or numbers beyond sense."""
    values = (math.nan, math.inf, -math.inf, 1e30, -1e30, 0.0)
    bad, where = world.random.choice(values), world.random.choice(("cx_px", "cy_px", "w_px", "h_px"))
    if bad == 0.0:
        where = "w_px"
    seen: list[float] = []

    def spoil(box: Box, now_s: float) -> Box:
        seen.append(now_s)
        return replace(box, **{where: bad})

    world.eyes.distort = spoil
    return lambda: len(seen) > 5


def score_absurd(world: FaultWorld) -> Happened:
    """A confidence that is no number."""
    world.eyes.confidence = world.random.choice((math.nan, math.inf, -math.inf, -1.0, 0.0))
    return _more(world, "delivered", 5)


def target_leaves(world: FaultWorld) -> Happened:
    """The target leaves the picture sideways, faster than the vehicle turns, for good; counts from its last sight."""
    world.target.speed_mps, world.target.weave_rad = 45.0, 0.0
    world.target.heading_rad = world.vehicle.pose().yaw_rad + world.random.choice((-1.0, 1.0)) * math.pi / 2
    unseen, seen = world.eyes.unseen, [0]

    def watch(now_s: float) -> None:
        if world.eyes.delivered - world.eyes.unseen != seen[0]:
            seen[0] = world.eyes.delivered - world.eyes.unseen
            world.caused(now_s)
        if world.eyes.unseen > unseen + 5:  # the vehicle turns after it, and at a distance it is slow again
            world.eyes.covered = True

    world.hooks.append(watch)
    return lambda: world.eyes.unseen > unseen + 5


def hidden_long(world: FaultWorld) -> Happened:
    """Behind something, for good."""
    world.eyes.covered = True
    return _more(world, "unseen", 10)


def hidden_briefly(world: FaultWorld) -> Happened:
    """Behind something, for less than a second."""
    world.eyes.covered = True
    happened = _more(world, "unseen", 2)
    world.loop.call_later(world.random.uniform(0.2, 0.7), lambda: setattr(world.eyes, "covered", False))
    return happened


def _turned(world: FaultWorld) -> Happened:
    """The target crosses; the harm counts from when the vehicle has turned as far as it takes to tell."""
    world.target_heading_rad = world.random.choice((-1.0, 1.0)) * world.random.uniform(1.3, 1.8)
    turned: list[bool] = []
    world.caused_when(lambda: abs(world.vehicle.pose().yaw_rad) > _TELLING_RAD and not turned.append(True))
    return lambda: bool(turned)


def camera_mirrored(world: FaultWorld) -> Happened:
    """The picture is a mirror image."""
    seen: list[float] = []

    def mirror(box: Box, now_s: float) -> Box:
        seen.append(now_s)
        return replace(box, cx_px=WIDTH_PX - box.cx_px)

    world.eyes.distort = mirror
    turned = _turned(world)
    return lambda: len(seen) > 5 and turned()


def camera_rolled(world: FaultWorld) -> Happened:
    """The camera is mounted upside down."""
    seen: list[float] = []

    def turn(box: Box, now_s: float) -> Box:
        seen.append(now_s)
        return replace(box, cx_px=WIDTH_PX - box.cx_px, cy_px=HEIGHT_PX - box.cy_px)

    world.eyes.distort = turn
    turned = _turned(world)
    return lambda: len(seen) > 5 and turned()


def target_comes(world: FaultWorld) -> Happened:
    """The target runs at the vehicle and on below it."""
    north, east, _ = (
        t - p for t, p in zip(world.target.position_ned_m, world.vehicle.pose().position_ned_m, strict=True)
    )
    world.target.heading_rad, world.target.weave_rad = math.atan2(-east, -north), 0.0
    world.target.speed_mps = world.random.uniform(3.0, 6.0)
    start_m = math.hypot(north, east)
    nearest = [start_m]
    world.hooks.append(lambda now_s: nearest.append(min(nearest[-1], math.hypot(*_away(world)))))
    return lambda: nearest[-1] < start_m - 3.0


def _away(world: FaultWorld) -> tuple[float, float]:
    """From the vehicle to the target, m north and east."""
    here, there = world.vehicle.pose().position_ned_m, world.target.position_ned_m
    return there[0] - here[0], there[1] - here[1]


def pictures_broken(world: FaultWorld) -> Happened:
    """What the decoder makes of damaged data cannot be tracked in."""
    failed: list[float] = []

    def fail(now_s: float) -> None:
        failed.append(now_s)
        raise ValueError("a damaged picture")

    world.eyes.fail = fail
    return lambda: len(failed) >= 1


def tracker_fails(world: FaultWorld) -> Happened:
    """Out of memory in the model."""
    failed: list[float] = []

    def fail(now_s: float) -> None:
        failed.append(now_s)
        raise RuntimeError("out of memory")

    world.eyes.fail = fail
    return lambda: len(failed) >= 1


def tracker_slow(world: FaultWorld) -> Happened:
    """Two seconds for a picture."""
    _after_those_under_way(world)
    world.eyes.track_s = world.random.uniform(0.6, 2.0)
    return _more(world, "delivered", 3)
