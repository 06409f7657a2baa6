"""What a command line says of the vehicle, over what the configuration says."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs.errors import GcsError

if TYPE_CHECKING:  # `gcs --help` needs no configuration
    from gcs.config import VehicleConfig


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """The arguments: which configuration, and which vehicle."""
    parser.add_argument("--config", metavar="FILE", help="configuration (YAML); `gcs config` prints one")
    text = "a ready-made configuration below that of the file (see `gcs config --profiles`)"
    parser.add_argument("--profile", metavar="NAME", help=text)
    add_link(parser)


def add_link(parser: argparse._ActionsContainer) -> None:
    """The arguments that change `vehicle` of the configuration."""
    add = parser.add_argument
    add("--vehicle", metavar="URL", help="udpin://HOST:PORT, udpout://, tcpout:// or serial:///dev/X:BAUD")
    add("--timeout", type=float, metavar="S", help="how long to wait for the vehicle")
    add("--signing-key", metavar="FILE", help="sign the link, and believe nothing unsigned (see `gcs keys`)")
    text = "how a follow reaches the vehicle: by setpoints, or by its own follow mode (default: setpoints)"
    add("--backend", choices=("setpoints", "follow-target"), help=text)
    text = "follow although `gcs audit` calls this parameter unsafe; repeat"
    add("--accept", metavar="NAME", action="append", default=[], help=text)


def with_arguments(vehicle: VehicleConfig, args: argparse.Namespace) -> VehicleConfig:
    """The configuration with what was given; GcsError for a time-out or a name that cannot be."""
    from gcs.audit import known_name
    from gcs.backend import Backend

    timeout_s = vehicle.timeout_s if args.timeout is None else args.timeout
    if not (math.isfinite(timeout_s) and timeout_s > 0):
        raise GcsError(f"--timeout {timeout_s:g}: must be more than 0")
    return replace(
        vehicle,
        url=args.vehicle or vehicle.url,
        timeout_s=timeout_s,
        signing_key=args.signing_key or vehicle.signing_key,
        backend=vehicle.backend if args.backend is None else Backend(args.backend),
        accept_parameters=(*vehicle.accept_parameters, *map(known_name, args.accept)),
    )
