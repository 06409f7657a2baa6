"""Where the target of a flight is on the earth, as the map and the vehicle's own follow mode have it too."""

from __future__ import annotations

import math
from typing import Final

from control.checks import fresh
from control.geolocation import moved_deg, target_fix
from gcs.flight import Flight
from gcs.flight_view import target_distance_m
from gcs.operator.camera.setup import TargetPlace

_PLACE_AGE_S: Final = 1.0


def place_of(flight: Flight) -> TargetPlace | None:
    """From the vehicle's place, the filtered line of sight and its distance; None where one of them is not known.

    Its velocity only while it is followed: before that nobody has looked at its size for long enough.
    """
    now_s, control, telemetry = flight.clock.now_s(), flight.control, flight.link.telemetry
    place, target, vehicle = telemetry.place, control.predict(now_s), telemetry.vehicle_state()
    if place is None or target is None or not fresh(place.t_s, now_s, _PLACE_AGE_S):
        return None
    held = control.confirmation if control.is_engaged else None
    config = flight.config.control.follow
    away_m = target_distance_m(target, vehicle, held, config)
    if away_m is None:
        return None
    motion = flight.tick.motion if flight.tick is not None and held is not None else None
    speeds = (0.0, 0.0) if motion is None else (motion.radial_mps, motion.tangential_mps)
    fix = target_fix(target, away_m, *speeds)
    if fix is None:
        return None
    flown_s = now_s - place.t_s
    north_m, east_m, down_m = (
        offset + speed * flown_s for offset, speed in zip(fix.offset_ned_m, vehicle.velocity_ned_mps, strict=True)
    )
    latitude_deg, longitude_deg = moved_deg(place.deg, (north_m, east_m))
    velocity = None if motion is None else fix.velocity_ned_mps
    sight_m = math.hypot(*fix.offset_ned_m)
    return TargetPlace(latitude_deg, longitude_deg, place.altitude_m - down_m, velocity, sight_m)
