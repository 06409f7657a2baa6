"""`gcs flights`: what has been recorded."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Final

from gcs.config import load
from gcs.errors import one_line, printable
from gcs.recorder.flights import RecordedFlight, list_flights

_HEAD: Final = ("flight", "started", "length", "size", "kind", "vehicle", "follows", "state")
_RIGHT: Final = frozenset({"length", "size", "follows"})


def main(args: argparse.Namespace) -> int:
    """A table, or a JSON line for each flight."""
    flights = list_flights(Path(args.folder or load(None).recorder.folder))
    if args.json:
        for flight in flights:
            print(json.dumps(_as_json(flight)))
    elif not flights:
        print("no flights are recorded there", file=sys.stderr)
    else:
        print("\n".join(_table(flights)))
    return 0


def _as_json(flight: RecordedFlight) -> dict[str, object]:
    return {
        "path": str(flight.path),
        "state": flight.state.value,
        "kind": flight.kind,
        "started_unix_s": flight.started_unix_s,
        "length_s": flight.length_s,
        "size_bytes": flight.size_bytes,
        "vehicle": flight.vehicle,
        "follows": flight.follows,
        "problems": list(flight.problems),
    }


def _table(flights: list[RecordedFlight]) -> list[str]:
    rows = [_HEAD, *map(_row, flights)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEAD))]
    lines = []
    for number, row in enumerate(rows):
        cells = (
            cell.rjust(width) if name in _RIGHT else cell.ljust(width)
            for name, cell, width in zip(_HEAD, row, widths, strict=True)
        )
        lines.append(printable("  ".join(cells).rstrip()))
        if number:
            lines += [f"  ! {one_line(problem)}" for problem in flights[number - 1].problems]
    return lines


def _row(flight: RecordedFlight) -> tuple[str, ...]:
    started = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(flight.started_unix_s)) if flight.started_unix_s else ""
    length = "" if flight.length_s is None else f"{int(flight.length_s) // 60}:{int(flight.length_s) % 60:02d}"
    follows = "" if flight.follows is None else str(flight.follows)
    size = f"{flight.size_bytes / 1e6:.1f} MB"
    return flight.path.name, started, length, size, flight.kind, flight.vehicle or "", follows, flight.state.value
