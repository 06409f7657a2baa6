"""Whether a recorded flight, flown again, comes out as it was recorded: every box, state and setpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path
from typing import Final

from gcs.config import Config, EngineName, Latent, TrackerConfig
from gcs.flight_vision import Seen
from gcs.recorder.events import Selected
from gcs.recorder.facts import NUMBER_VARIABLES, machine, software
from gcs.recorder.folder import in_progress_note
from gcs.recorder.manifest import Manifest, ManifestError, WeightsFacts, read_manifest
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, FrameRow, ReplayError
from gcs.tracking import make_tracker
from gcs.verify.again import Again, recorded_seen, without_picture
from gcs.verify.compare import EXACT, Comparison, Tolerance
from gcs.verify.eyes import DivergedError, EyesAgain

# Another processor adds in another order. Of a thousand pictures no box has moved by more; see docs/recording.md.
ELSEWHERE: Final = Tolerance(absolute=0.05, relative=1e-3)

Progress = Callable[[str], None]
SeenOf = Callable[[int, FrameRow], Seen]


class Start(Enum):
    """Where to begin: with the pictures, or with the boxes that were recorded."""

    TRACKER = "tracker"
    CONTROL = "control"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came out. elsewhere: what is other than it was when it was flown. problems: why less could be compared.

    tracked: pictures through the tracker again. furthest: of floats within the tolerance, by field.
    """

    folder: str
    start: Start
    equal: bool
    exact: bool
    tracked: int
    compared: dict[str, int]
    differing: dict[str, int]
    first: str | None
    furthest: dict[str, float]
    elsewhere: tuple[str, ...]
    problems: tuple[str, ...]

    def lines(self) -> list[str]:
        """For the terminal."""
        counts = ", ".join(f"{count} {_NAMES[what]}" for what, count in self.compared.items())
        again = f" ({self.tracked} pictures tracked again)" if self.start is Start.TRACKER else " (boxes as recorded)"
        if self.exact:
            said = [f"the same to the last bit: {counts}{again}"]
        elif self.equal:
            name, distance = max(self.furthest.items(), key=lambda item: item[1])
            said = [f"the same within the tolerance: {counts}{again}; furthest apart: {name} by {distance:.2g}"]
        else:
            wrong = ", ".join(
                f"{count} of {self.compared[what]} {_NAMES[what]}" for what, count in self.differing.items()
            )
            said = [f"NOT THE SAME: {wrong}{again}", f"first: {self.first}"]
        said += [f"other than in the flight: {each}" for each in self.elsewhere]
        return said + [f"note: {problem}" for problem in self.problems]


# What last bits depend on. Decisions are made of the smallest matrices, which gcs/__init__.py has added up in one order
# on every x86-64; the network's order is the processor's own.
_CONTROL: Final = ("architecture", "numpy", "scipy", "filterpy")
_BITS: Final = {
    Start.CONTROL: _CONTROL,
    Start.TRACKER: (
        *_CONTROL,
        "cpu",
        "cpu_flags",
        "torch",
        "onnxruntime",
        "openvino",
        "opencv-python-headless",
        "av",
        *NUMBER_VARIABLES,
    ),
}
_NAMES: Final = {"Tick": "decisions", "FrameRecord": "frames", "Expected": "expectations"}


@dataclass(slots=True)
class Recorded:
    """A flight's folder, opened for flying it again. Raises ReplayError or ManifestError where that cannot be."""

    folder: Path
    log: FlightLog
    manifest: Manifest
    config: Config
    size: tuple[int, int]

    @classmethod
    def open(cls, folder: Path) -> Recorded:
        """Of one folder."""
        manifest = read_manifest(folder)
        if manifest.kind == "import":
            raise ManifestError(f"{folder}: another station's flight, so nothing here decided in it")
        if manifest.video is None:
            raise ManifestError(f"{folder}: no video was flown by, so there is nothing to fly again")
        size = manifest.video.width_px, manifest.video.height_px
        return cls(folder, FlightLog(folder), manifest, manifest.configuration, size)

    def elsewhere(self, start: Start) -> tuple[str, ...]:
        """What is other here and now than in the flight, of all that last bits depend on; empty: none may differ."""
        then = {**self.manifest.software, **self.manifest.machine}
        now = {**software(), **machine()}
        return tuple(
            f"{name} {now.get(name, 'missing')}, was {then.get(name, 'missing')}"
            for name in _BITS[start]
            if now.get(name) != then.get(name)
        )

    def problems(self) -> tuple[str, ...]:
        """Of the record."""
        found = in_progress_note(self.folder)
        if self.log.dropped:
            found.append(f"{self.log.dropped} events were not recorded: what follows them may differ")
        if self.log.damaged:
            found.append(f"{self.log.damaged} lines of the log cannot be read")
        if self.log.astray:
            found.append(f"{self.log.astray} lines of the log have a time that cannot be: what follows them may differ")
        return tuple(found)


def verify(folder: Path, start: Start, progress: Progress, tolerance: Tolerance | None = None) -> Verdict:
    """Fly it again and compare. Raises ReplayError or ManifestError where it cannot be flown again at all.

    tolerance: None allows none, but elsewhere than it was flown `ELSEWHERE`.
    """
    recorded = Recorded.open(folder)
    elsewhere, problems = recorded.elsewhere(start), list(recorded.problems())
    comparison = Comparison(tolerance or (ELSEWHERE if elsewhere else EXACT))
    seen_of: SeenOf = recorded_seen
    tracked = 0
    if start is Start.TRACKER:
        seen, problem = track_again(recorded, recorded.config, progress)
        tracked = len(seen)
        problems += [problem] if problem is not None else []
        seen_of = _of(seen)
    again = Again(recorded.config, recorded.size, comparison, flown=recorded.config)
    total = len(recorded.log)
    for done, _ in enumerate(again.run(recorded.log.with_data(), seen_of)):
        if done % 2000 == 0:
            progress(f"decisions: {done / total:.0%}")
    if not comparison.compared:
        raise ReplayError(f"{recorded.log.path}: neither a frame nor a decision in it")
    return Verdict(
        str(folder), start, comparison.is_equal, comparison.is_exact, tracked, comparison.compared,
        comparison.differing, None if comparison.first is None else str(comparison.first), comparison.furthest,
        elsewhere, tuple(problems),
    )  # fmt: skip


def _of(seen: dict[int, Seen]) -> SeenOf:
    return lambda number, row: seen.get(number) or recorded_seen(number, row)


def as_flown(config: TrackerConfig, facts: WeightsFacts | None) -> TrackerConfig:
    """With the engine of then: another, or other threads, add in another order."""
    if facts is None:
        return config
    try:
        engine = EngineName(facts.engine.removesuffix("-int8"))
        latent = config.latent or (None if facts.latent is None else Latent(facts.latent))
        return replace(
            config, weights=config.weights or facts.name, engine=engine, threads=facts.threads, latent=latent
        )
    except ValueError as error:
        raise ManifestError(f"the flight's tracker cannot be made again: {error}") from error


def as_wanted(wanted: TrackerConfig, flown: TrackerConfig, facts: WeightsFacts | None) -> TrackerConfig:
    """As flown, except for what is wanted otherwise than the flight's configuration had it."""
    values = {each.name: getattr(wanted, each.name) for each in fields(wanted)}
    changed = {name: value for name, value in values.items() if value != getattr(flown, name)}
    return replace(as_flown(flown, facts), **changed)


def track_again(recorded: Recorded, config: Config, progress: Progress) -> tuple[dict[int, Seen], str | None]:
    """Every frame through the tracker of this configuration, by number; and why it ended before the last, if it did."""
    film = Film(recorded.folder)
    seen: dict[int, Seen] = {}
    if film.problem is not None:
        return seen, film.problem
    progress("loading the tracker")
    tracker = make_tracker(as_wanted(config.tracker, recorded.config.tracker, recorded.manifest.weights))
    eyes = EyesAgain(tracker, film.picture)
    total = len(recorded.log)
    try:
        for done, (_, number, message) in enumerate(recorded.log):
            if isinstance(message, Selected):
                eyes.selected(message)
            elif isinstance(message, FrameRow) and number is not None:
                for each in eyes.saw(number, message):
                    seen[each.frame.seq] = without_picture(each)
                if done % 20 == 0:
                    progress(f"tracker: {done / total:.0%}")
    except DivergedError as error:
        return seen, f"pictures were tracked again up to frame {max(seen, default=0)} only: {error}"
    finally:
        film.close()
    return seen, None
