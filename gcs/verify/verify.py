"""Whether a recorded flight, flown again, comes out as it was recorded: every box, state and setpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
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

    tracked: pictures through the tracker again. whole: all that should be; without, nothing is proved: neither equal
    nor exact. furthest: of floats within the tolerance, by field. others: weights or code that are other than in the
    flight; what they change is a difference, so that they allow no tolerance.
    """

    folder: str
    start: Start
    equal: bool
    exact: bool
    tracked: int
    whole: bool
    compared: dict[str, int]
    differing: dict[str, int]
    first: str | None
    furthest: dict[str, float]
    elsewhere: tuple[str, ...]
    others: tuple[str, ...]
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
        elif self.differing:
            wrong = ", ".join(
                f"{count} of {self.compared[what]} {_NAMES[what]}" for what, count in self.differing.items()
            )
            said = [f"NOT THE SAME: {wrong}{again}", f"first: {self.first}"]
        else:
            said = [f"NOT PROVED, though nothing differs: {counts}{again}"]
        if not self.whole:
            frames = self.compared.get("FrameRecord", 0)
            said.append(f"only {self.tracked} of {frames} pictures could be tracked again: use --from control")
        said += [f"other than in the flight: {each}" for each in (*self.elsewhere, *self.others)]
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
_SHOWN: Final = 12  # characters of a SHA-256
_NAMES: Final = {"Tick": "decisions", "FrameRecord": "frames", "Expected": "expectations"}


@dataclass(slots=True)
class Recorded:
    """A flight's folder, opened for flying it again. Raises ReplayError or ManifestError where that cannot be.

    others: what is other than in the flight but allows no tolerance; the weights once they are loaded.
    """

    folder: Path
    log: FlightLog
    manifest: Manifest
    config: Config
    size: tuple[int, int]
    others: list[str] = field(default_factory=list)

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

    def other(self, name: str, now: str, then: str | None) -> None:
        """Note code or weights, each by its SHA-256, where they are other than in the flight."""
        if now != then:
            self.others.append(f"{name} {now[:_SHOWN]}, was {(then or 'missing')[:_SHOWN]}")

    def problems(self) -> tuple[str, ...]:
        """Of the record, once all of its log has been gone through."""
        still = in_progress_note(self.folder)
        found = [*still, *self.manifest.problems]
        if self.manifest.ended is None and not still:
            found.append("the flight was not ended in order: its record may end before it did")
        if self.log.is_cut and not still:
            found.append("the last line of the log is cut off")
        if self.manifest.dropped > self.log.dropped:
            found.append(f"{self.manifest.dropped} records of the flight were not written in time")
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
    elsewhere = recorded.elsewhere(start)
    comparison = Comparison(tolerance or (ELSEWHERE if elsewhere else EXACT))
    recorded.other("code", software()["code"], recorded.manifest.software.get("code"))
    seen_of: SeenOf = recorded_seen
    tracked, problem = 0, None
    if start is Start.TRACKER:
        seen, problem = track_again(recorded, recorded.config, progress)
        tracked = len(seen)
        seen_of = _of(seen)
    again = Again(recorded.config, recorded.size, comparison, flown=recorded.config)
    total = len(recorded.log)
    for done, _ in enumerate(again.run(recorded.log.with_data(), seen_of)):
        if done % 2000 == 0:
            progress(f"decisions: {done / total:.0%}")
    if not comparison.compared:
        raise ReplayError(f"{recorded.log.path}: neither a frame nor a decision in it")
    whole = start is Start.CONTROL or 0 < tracked == comparison.compared.get("FrameRecord")
    if not whole and problem is None:
        problem = "the record does not tell of each picture how it was tracked"
    problems = (*recorded.problems(), *([] if problem is None else [problem]))
    return Verdict(
        str(folder), start, whole and comparison.is_equal, whole and comparison.is_exact, tracked, whole,
        comparison.compared, comparison.differing, None if comparison.first is None else str(comparison.first),
        comparison.furthest, elsewhere, tuple(recorded.others), problems,
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
    """Every frame through the tracker of this configuration, by number; and why not all of them, or not all is sure."""
    film = Film(recorded.folder)
    seen: dict[int, Seen] = {}
    if not film.is_there or not film.is_exact:
        film.close()
        if not film.is_there:
            return seen, film.problem or f"{recorded.folder}: no picture of its film can be read"
        how = "has the overlay drawn in" if film.is_annotated else "is JPEG"
        return seen, f"the film {how}, not what was tracked: use --from control"
    progress("loading the tracker")
    facts = recorded.manifest.weights
    tracker = make_tracker(as_wanted(config.tracker, recorded.config.tracker, facts))
    loaded = getattr(tracker, "loaded", None)
    if facts is not None and loaded is not None:
        recorded.other("weights", loaded.sha256, facts.sha256)
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
        problem = f"pictures were tracked again up to frame {max(seen, default=0)} only: {error}"
        return seen, problem if film.problem is None else f"{problem} ({film.problem})"
    finally:
        film.close()
    return seen, film.problem
