"""Who is heard in a telemetry log, and for how long: told by the heartbeats alone, so quickly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs import codec
from gcs.cli.progress import shown_progress
from gcs.codec import VehicleId
from gcs.framing import Deframer, dialect, message_id
from gcs.tlog_import.tlog import Tlog, TlogError

_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT


@dataclass(frozen=True, slots=True)
class Survey:
    """vehicle: the one to import. See `Tlog` for the rest."""

    vehicle: VehicleId
    frames: int
    span_s: float
    unix_start_s: float


def survey(tlog: Tlog, system_id: int | None) -> Survey:
    """system_id: of the vehicle that is wanted. TlogError where there is none, or several and none is wanted."""
    vehicles: dict[int, VehicleId] = {}
    unusable, heard = "", False
    deframer = Deframer()
    for _, frame in shown_progress(tlog, "looking", "frames"):
        if message_id(frame) != _HEARTBEAT:
            continue
        for message in deframer.datagram(frame):
            heard = True
            vehicle = codec.identify(message)
            if vehicle is not None:
                vehicles.setdefault(vehicle.system_id, vehicle)
            else:
                unusable = codec.unusable_reason(message) or unusable
    return Survey(_chosen(tlog, vehicles, system_id, unusable, heard), tlog.frames, tlog.span_s, tlog.unix_start_s)


def _chosen(tlog: Tlog, vehicles: dict[int, VehicleId], system_id: int | None, unusable: str, heard: bool) -> VehicleId:
    names = ", ".join(map(str, vehicles.values()))
    if system_id is not None and system_id not in vehicles:
        found = f"there is {names}" if names else unusable or "there is no vehicle in it"
        raise TlogError(f"{tlog.path}: no vehicle of system {system_id}: {found}")
    if not vehicles:
        why = unusable or (
            "only ground stations or cameras are heard" if heard else "no heartbeat is heard; is it a telemetry log?"
        )
        raise TlogError(f"{tlog.path}: no vehicle in it: {why}")
    if system_id is None and len(vehicles) > 1:
        raise TlogError(f"{tlog.path}: several vehicles in it: {names}; choose one with --system")
    return vehicles[system_id] if system_id is not None else next(iter(vehicles.values()))
