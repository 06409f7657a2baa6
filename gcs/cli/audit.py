"""`gcs audit`: the vehicle's parameters, judged as before a flight; sets nothing."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import sys
import textwrap
from typing import Final

from gcs.audit import Audit, Level, judge, rules_of
from gcs.autopilot.parameters import read_parameters
from gcs.cli.args_vehicle import with_arguments
from gcs.clock import MonotonicClock
from gcs.config import VehicleConfig, load
from gcs.signing import open_signing, security
from gcs.wire import Wire

_UNSAFE: Final = 1
_WIDTH: Final = 100


def main(args: argparse.Namespace) -> int:
    """0: a follow may start. 1: something is unsafe and not accepted."""
    audit = asyncio.run(_audit(with_arguments(load(args.config, args.profile).vehicle, args)))
    print(_json(audit) if args.json else table(audit))
    return 0 if audit.ok else _UNSAFE


def _say(text: str) -> None:
    print(f"gcs: {text}", file=sys.stderr, flush=True)


async def _audit(wanted: VehicleConfig) -> Audit:
    clock = MonotonicClock()
    signing = await asyncio.to_thread(open_signing, wanted.signing_key, clock)
    wire = await Wire.open(wanted.url, clock=clock, vehicle_system_id=wanted.system_id, signing=signing)
    try:
        _say(f"waiting for a vehicle at {wire.url}")
        vehicle = await wire.wait_vehicle(wanted.timeout_s)
        _say(f"{vehicle}, {security(wire.signing, wire.vehicle_signs)}")
        names = [rule.names for rule in rules_of(vehicle.autopilot.name, wanted.backend)]
        values = await read_parameters(wire, clock, names, _say)
        return judge(vehicle.autopilot.name, values, wanted.accept_parameters, wanted.backend)
    finally:
        await wire.close()


def table(audit: Audit) -> str:
    """The findings, and the lines that put right what is not fine."""
    lines = [f"{audit.autopilot}: {'a follow may start' if audit.ok else 'unsafe: no follow will start'}"]
    for finding in audit.findings:
        value = "no answer" if finding.value is None else f"{finding.value:g}"
        verdict = "accepted" if finding.accepted and finding.level is Level.UNSAFE else finding.level.value
        lines.append(f"  {verdict:9s} {finding.name:16s} {value:>10s}   wanted {finding.wanted}")
        if finding.level is not Level.FINE:
            lines.append(textwrap.fill(finding.why, _WIDTH, initial_indent=" " * 12, subsequent_indent=" " * 12))
    to_set = [finding for finding in audit.findings if finding.level is not Level.FINE and finding.value is not None]
    if to_set:
        lines.append("To set in the autopilot's shell or a station that writes parameters:")
        lines += [f"  param set {finding.name} {finding.set_to:g}" for finding in to_set]
    return "\n".join(lines)


def _json(audit: Audit) -> str:
    rows = [
        {
            "name": finding.name,
            "value": finding.value if finding.value is not None and math.isfinite(finding.value) else None,
            "wanted": finding.wanted,
            "set_to": finding.set_to,
            "level": finding.level.value,
            "accepted": finding.accepted,
            "why": finding.why,
        }
        for finding in audit.findings
    ]
    return json.dumps({"autopilot": audit.autopilot, "ok": audit.ok, "parameters": rows})
