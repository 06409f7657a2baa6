"""Trackers over the same pictures: this one in each configuration and engine, and OpenCV's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

import cv2

from gcs.benchmark.films import Film, Image
from gcs.benchmark.timing import BenchError, Case, Sample, timed, use_threads
from gcs.tracking import Learner
from tracker.box import Box
from tracker.configs import FULL, LatentProvider, TrackerConfig
from tracker.engines.catalogue import TORCH, available_engines, make_engine
from tracker.engines.engine import EngineError
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker
from tracker.weights import DATA, load_network, read_manifest

REFERENCE: Final = "compact, torch"  # at one thread every ratio is 1 to this
_FEW: Final = 2  # pictures a turn of what takes a large part of a second for one
_MANY: Final = 10  # of everything else: the filter learns from every fifth, the re-detection from every tenth
_WARM: Final = 2


class Contestant(Protocol):
    """Anything that tracks."""

    def init(self, frame_bgr: Image, box: Box) -> None:
        """The first picture."""

    def update(self, frame_bgr: Image) -> object:
        """The next."""


class OnFilm:
    """A tracker that goes through a film over and over; init is not timed."""

    uneven = True

    def __init__(
        self, name: str, film: Film, make: Callable[[], Contestant], *, threads: int = 1, frames: int = _MANY,
        warm: int = _WARM, most_turns: int | None = None, beside: int | None = None,
    ) -> None:  # fmt: skip
        """make: called at the first turn. frames: timed in each turn, after `warm` more.

        beside: threads of PyTorch and OpenCV, where they are not those that are counted.
        """
        self._turns_left = most_turns
        self.name, self.threads = name, threads
        self._beside = beside or threads
        self._film, self._make, self._frames, self._warm = film, make, frames, warm
        self._tracker: Contestant | None = None
        self._next = 0

    def turn(self) -> list[Sample]:
        """See Case; nothing once it had its turns."""
        if self._turns_left == 0:
            return []
        if self._turns_left is not None:
            self._turns_left -= 1
        use_threads(self._beside)
        samples = [self._step() for _ in range(self._warm + self._frames)]
        return samples[self._warm :]

    def _step(self) -> Sample:
        try:
            if self._tracker is None:
                self._tracker = self._make()
            self._next = (self._next + 1) % len(self._film.frames)
            if self._next <= 1:  # at the beginning, or the film is over
                self._tracker.init(self._film.frames[0], self._film.box)
                self._next = 1
            frame = self._film.frames[self._next]
            tracker = self._tracker

            def whole() -> None:
                tracker.update(frame)
                if isinstance(tracker, Learner):
                    tracker.learn()  # else it would count with the next picture

            return timed(whole)
        except (EngineError, cv2.error, ValueError) as error:
            raise BenchError(str(error).strip().splitlines()[0]) from error


class OfOpenCV:
    """One of OpenCV's, whose boxes are whole (x, y, w, h)."""

    def __init__(self, make: Callable[[], cv2.Tracker]) -> None:
        self._make = make
        self._tracker = make()

    def init(self, frame_bgr: Image, box: Box) -> None:
        """They take only one target in their life."""
        self._tracker = self._make()
        x, y, w, h = (round(v) for v in box.xywh)
        self._tracker.init(frame_bgr, (x, y, w, h))

    def update(self, frame_bgr: Image) -> object:
        """See Contestant."""
        return self._tracker.update(frame_bgr)


@dataclass(frozen=True, slots=True)
class Weights:
    """What may be compared: weights that ship, or a network with random ones. path: None for these."""

    name: str
    path: Path | None

    def network(self) -> ClimRT:
        """As trained."""
        return ClimRT(FULL).eval() if self.path is None else load_network(self.path)

    def tracker(self, engine: str, threads: int, latent: LatentProvider | None = None) -> ClimRTTracker:
        """Ready for init."""
        manifest = None if self.path is None else read_manifest(self.path)
        config = TrackerConfig() if manifest is None else manifest.tracker
        config = config if latent is None else replace(config, latent=latent)
        climnet = config.latent is LatentProvider.CLIMNET
        made = make_engine(engine, self.network(), threads, climnet=climnet)
        return ClimRTTracker(made, config, confidence=None if manifest is None else manifest.confidence)


def shipped() -> tuple[Weights, ...]:
    """All that come with the program."""
    return tuple(Weights(path.stem, path) for path in sorted(DATA.glob("*.safetensors")))


def full() -> Weights:
    """The paper's network: the shipped one, or with random weights, which cost the same."""
    return next((weights for weights in shipped() if weights.name == "full"), Weights("full", None))


def reference(film: Film) -> Case:
    """What every ratio is made with: the shipped tracker in the reference engine, one thread."""
    weights = next(weights for weights in shipped() if weights.name == "compact")
    return _case(REFERENCE, weights, TORCH, film, 1)


def ours(film: Film, threads: int, *, quick: bool) -> Iterator[Case]:
    """This tracker, as it ships and as the paper has it."""
    light = [weights for weights in shipped() if weights.name != "full"]
    for weights in light:
        for engine in available_engines():
            yield _case(f"{weights.name}, {engine}", weights, engine, film, threads)
    for weights in light:
        name = f"{weights.name} with ClimNet, {TORCH}"
        yield _case(name, weights, TORCH, film, threads, LatentProvider.CLIMNET, few=True)
    if quick:
        return
    for engine in available_engines():
        yield _case(f"full, {engine}", full(), engine, film, threads, LatentProvider.PREVIOUS, few=True)


def paper(film: Film, threads: int) -> Case:
    """The paper's own configuration: seconds a picture on a CPU."""
    make = lambda: full().tracker(TORCH, threads, LatentProvider.CLIMNET)  # noqa: E731
    return OnFilm(f"full with ClimNet, {TORCH}", film, make, threads=threads, frames=1, warm=0, most_turns=1)


def _case(
    name: str, weights: Weights, engine: str, film: Film, threads: int, latent: LatentProvider | None = None,
    *, few: bool = False,
) -> Case:  # fmt: skip
    def make() -> ClimRTTracker:
        return weights.tracker(engine, threads, latent)

    frames, warm = (_FEW, 1) if few else (_MANY, _WARM)
    beside = None if engine == TORCH else 1  # as load_tracker has it
    return OnFilm(name, film, make, threads=threads, frames=frames, warm=warm, beside=beside)


def of_opencv(
    film: Film, threads: int, nano: tuple[Path, Path] | None, vit: Path | None, note: Callable[[str], None]
) -> Iterator[Case]:
    """OpenCV's own: MIL, and those whose network files are given. nano: backbone and head."""
    yield OnFilm("OpenCV MIL", film, lambda: OfOpenCV(cv2.TrackerMIL.create), threads=threads, frames=_FEW, warm=1)
    if nano is not None and _are_there("OpenCV Nano", nano, note):
        backbone, head = map(str, nano)
        yield OnFilm("OpenCV Nano", film, lambda: OfOpenCV(lambda: _nano(backbone, head)), threads=threads)
    if vit is not None and _are_there("OpenCV Vit", (vit,), note):
        yield OnFilm("OpenCV Vit", film, lambda: OfOpenCV(lambda: _vit(str(vit))), threads=threads)


def _are_there(name: str, files: tuple[Path, ...], note: Callable[[str], None]) -> bool:
    missing = [str(file) for file in files if not file.is_file()]
    if missing:
        note(f"{name}: no such file: {', '.join(missing)}")
    return not missing


def _nano(backbone: str, head: str) -> cv2.Tracker:
    settings = cv2.TrackerNano.Params()
    settings.backbone, settings.neckhead = backbone, head
    return cv2.TrackerNano.create(settings)


def _vit(net: str) -> cv2.Tracker:
    settings = cv2.TrackerVit.Params()
    settings.net = net
    return cv2.TrackerVit.create(settings)
