"""Short recorded flights of the mocked camera: a video, boxes and telemetry each.

`NAME.mp4`; `NAME.txt`, one box per frame as x,y,w,h in px (NaN where the target cannot be seen);
`NAME.jsonl`, one object per frame: t_s, roll_rad, pitch_rad, yaw_rad, position_ned_m, velocity_ned_mps of the
vehicle, and the lens in `NAME.json`. Made by `python -m sitl_mocks.sequences.render`.
"""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent / "data"


def names() -> list[str]:
    """The recorded sequences that come with the package."""
    return sorted(file.stem for file in _FOLDER.glob("*.mp4"))


def path(name: str, suffix: str = ".mp4") -> Path:
    """A file of a sequence: .mp4, .txt (boxes), .jsonl (telemetry) or .json (lens). Raises ValueError."""
    if name not in names():
        raise ValueError(f"sequence {name!r} is not known; there are: {', '.join(names())}")
    file = _FOLDER / f"{name}{suffix}"
    if not file.is_file():
        raise ValueError(f"sequence {name!r} has no {suffix} file")
    return file
