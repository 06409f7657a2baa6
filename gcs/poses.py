"""Where the vehicle was while a video was recorded, for dry runs: one JSON object per line.

Keys: t_s (video time), roll_rad, pitch_rad, yaw_rad; optional position_ned_m and velocity_ned_mps (three numbers).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from pathlib import Path

import msgspec

from control.attitude import AttitudeBuffer, wrap_pi
from gcs.dryrun.rehearsal import Pose
from gcs.errors import GcsError, one_line

Vec3 = tuple[float, float, float]


class PoseError(GcsError):
    """A telemetry file that cannot be used; names the file and the line."""


class Row(msgspec.Struct, frozen=True):
    """One line of the file."""

    t_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    position_ned_m: Vec3 | None = None
    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)


class RecordedPoses:
    """Poses by video time; attitude interpolated, position and velocity those of the line before."""

    def __init__(self, rows: list[Row]) -> None:
        self._rows = rows
        self._times_s = [row.t_s for row in rows]
        self._attitudes = AttitudeBuffer(capacity=len(rows) + 2)
        for row in rows:
            self._attitudes.add(row.t_s, row.roll_rad, row.pitch_rad, row.yaw_rad)

    @classmethod
    def load(cls, path: Path) -> RecordedPoses:
        """Raises PoseError naming file and line."""
        decoder = msgspec.json.Decoder(Row)
        rows: list[Row] = []
        try:
            lines = path.read_bytes().splitlines()
        except OSError as error:
            raise PoseError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                row = decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise PoseError(one_line(f"{path}:{number}: {error}")) from error
            if not all(map(math.isfinite, msgspec.structs.astuple(row)[:4])):
                raise PoseError(f"{path}:{number}: not a finite number")
            if rows and row.t_s <= rows[-1].t_s:
                raise PoseError(f"{path}:{number}: t_s {row.t_s:g} is not after the line before")
            rows.append(row)
        if not rows:
            raise PoseError(f"{path}: no telemetry in it")
        return cls(rows)

    def at(self, t_s: float) -> Pose:
        """The pose at this video time; before the first and after the last line, that line's."""
        index = max(0, bisect_right(self._times_s, t_s) - 1)
        row = self._rows[index]
        attitude = self._attitudes.at(t_s) or (row.roll_rad, row.pitch_rad, row.yaw_rad)
        return Pose(
            attitude_rpy_rad=attitude,
            yaw_rate_rps=self._yaw_rate_rps(index),
            position_ned_m=row.position_ned_m or (0.0, 0.0, 0.0),
            velocity_ned_mps=row.velocity_ned_mps,
            height_m=None if row.position_ned_m is None else -row.position_ned_m[2],
        )

    def _yaw_rate_rps(self, index: int) -> float:
        if index == 0:
            return 0.0
        before, row = self._rows[index - 1], self._rows[index]
        return wrap_pi(row.yaw_rad - before.yaw_rad) / (row.t_s - before.t_s)
