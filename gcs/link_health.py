"""What of the connection concerns following: loss, other stations, the vehicle's echo of our setpoints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:  # a dry run has no link, and imports none
    from gcs.telemetry import SetpointEcho, Telemetry
    from gcs.wire import Wire

_MUCH_LOSS_FRAC: Final = 0.2
_FOREIGN_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """lossy: more than a fifth of the telemetry of the last two seconds is missing. echo: the newest.

    unheard: the vehicle has stopped to answer. one_way_s: a message takes so long; None: it never answered.
    """

    lossy: bool = False
    foreign_station: bool = False
    echo: SetpointEcho | None = None
    unheard: bool = False
    one_way_s: float | None = None


def link_health(wire: Wire, telemetry: Telemetry, now_s: float) -> LinkHealth:
    """As it is now."""
    return LinkHealth(
        lossy=wire.loss.loss_frac(now_s) > _MUCH_LOSS_FRAC,
        foreign_station=any(now_s - t_s < _FOREIGN_S for t_s in telemetry.foreign_stations.values()),
        echo=telemetry.setpoint_echo,
        unheard=telemetry.round_trip.is_unheard(now_s),
        one_way_s=telemetry.round_trip.one_way_s,
    )
