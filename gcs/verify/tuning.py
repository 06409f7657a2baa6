"""`gcs replay FLIGHT --with CONFIG`: what another configuration would have commanded, beside what was.

The vehicle flies as it did: what the other commands would have changed in its path, and so in the pictures, is not
told. For that fly it in the simulator.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import yaml

from gcs.config import Config
from gcs.config_yaml import load_layers
from gcs.errors import GcsError
from gcs.replay.log import TickRow
from gcs.result_file import result_file
from gcs.verify.again import Again, recorded_seen
from gcs.verify.course import Course, apart
from gcs.verify.verify import Progress, Recorded, SeenOf, Start, track_again


class NothingChangedError(GcsError):
    """A configuration that is the flight's own."""


class _Unheard:
    """Nothing is compared event by event."""

    def event(self, what: str, frame: int | None, t_s: float, recorded: msgspec.Raw, again: object) -> None:
        """It is another flight."""


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Both courses in figures, and how far they are apart. changed: key: (flown with, now). picture: of both."""

    folder: str
    start: Start
    changed: dict[str, tuple[Any, Any]]
    flown: dict[str, float]
    otherwise: dict[str, float]
    apart: dict[str, float]
    picture: str
    problems: tuple[str, ...] = field(default=())

    def lines(self) -> list[str]:
        """A table for the terminal."""
        found = [f"{key}: {old} as flown, {new} now" for key, (old, new) in self.changed.items()]
        names = list(dict.fromkeys([*self.flown, *self.otherwise]))
        width = max(map(len, names), default=0)
        found += ["", f"{'':{width}}  {'as flown':>10} {'with it':>10}"]
        for name in names:
            old, new = self.flown.get(name, 0.0), self.otherwise.get(name, 0.0)
            found.append(f"{name:{width}}  {old:10.2f} {new:10.2f}")
        found += ["", "apart: " + "; ".join(f"{name} {value:.2f}" for name, value in self.apart.items())]
        found += ["the vehicle flies as it did: what it would have seen on another path is not told"]
        return [*found, f"both over time: {self.picture}", *(f"note: {problem}" for problem in self.problems)]


def compare_with(folder: Path, path: Path, start: Start | None, progress: Progress) -> WhatIf:
    """The flight with what this file says otherwise. GcsError as for reading both. start: None chooses."""
    recorded = Recorded.open(folder)
    config = laid_over(recorded.config, path)
    changed = _changed(msgspec.to_builtins(recorded.config), msgspec.to_builtins(config))
    if not changed:
        raise NothingChangedError(f"{path}: says nothing that {folder} was not flown with")
    if start is None:
        start = Start.TRACKER if any(key.startswith("tracker.") for key in changed) else Start.CONTROL
    seen_of: SeenOf = recorded_seen
    problem = None
    if start is Start.TRACKER:
        seen, problem = track_again(recorded, config, progress)
        seen_of = lambda number, row: seen.get(number) or recorded_seen(number, row)  # noqa: E731
    flown, otherwise = _both(recorded, config, seen_of, progress)
    picture = folder / f"with-{path.stem}.png"
    draw(picture, flown, otherwise, path.name)
    return WhatIf(
        str(folder), start, changed, flown.figures(), otherwise.figures(), apart(flown, otherwise), str(picture),
        (*recorded.problems(), *([] if problem is None else [problem])),
    )  # fmt: skip


def laid_over(flown: Config, path: Path) -> Config:
    """What the file says over what was flown with. ConfigError with file, line and key."""
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "flown.yaml"
        base.write_text(yaml.safe_dump(msgspec.to_builtins(flown)))
        return load_layers([base, path], Config).value


def _changed(old: Any, new: Any, prefix: str = "") -> dict[str, tuple[Any, Any]]:
    if not (isinstance(old, dict) and isinstance(new, dict)):
        return {} if old == new else {prefix: (old, new)}
    found: dict[str, tuple[Any, Any]] = {}
    for key in old:
        found |= _changed(old[key], new[key], f"{prefix}.{key}" if prefix else key)
    return found


def _both(recorded: Recorded, config: Config, seen_of: SeenOf, progress: Progress) -> tuple[Course, Course]:
    flown, otherwise, log = Course(), Course(), recorded.log
    for _, _, message in log:
        if isinstance(message, TickRow):
            flown.add(message)
    again = Again(config, recorded.size, _Unheard(), flown=recorded.config)
    for done, tick in enumerate(again.run(log.with_data(), seen_of)):
        if tick is not None:
            otherwise.add(tick)
        if done % 2000 == 0:
            progress(f"decisions: {done / len(log):.0%}")
    return flown, otherwise


def draw(path: Path, flown: Course, otherwise: Course, name: str) -> None:
    """Both as a PNG: velocities, yaw rate, and where the states differ."""
    from matplotlib.figure import Figure  # a second that nobody else should wait for

    figure = Figure(figsize=(11, 8), dpi=100, layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    start_s = flown.t_s[0] if flown.t_s else 0.0
    times = [t_s - start_s for t_s in flown.t_s]
    rows = (
        ("north (m/s)", flown.north_mps, otherwise.north_mps), ("east (m/s)", flown.east_mps, otherwise.east_mps),
        ("yaw rate (rad/s)", flown.yaw_rate_rps, otherwise.yaw_rate_rps),
    )  # fmt: skip
    for axes, (label, old, new) in zip(panels, rows, strict=True):
        axes.plot(times, old, color="0.55", linewidth=2, label="as flown")
        axes.plot(times, new, color="tab:blue", linewidth=1, label=f"with {name}")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        for index in range(1, len(times)):
            if flown.states[index] != otherwise.states[index]:
                axes.axvspan(times[index - 1], times[index], color="tab:orange", alpha=0.25, linewidth=0)
    panels[0].legend(loc="best", fontsize="small")
    panels[0].set_title("orange: in another state than flown")
    panels[-1].set_xlabel("time (s)")
    try:
        with result_file(path) as file:
            figure.savefig(file, format="png")
    except OSError as error:
        raise GcsError(f"{path}: {(error.strerror or str(error)).lower()}") from error
