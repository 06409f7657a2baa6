"""The tracker: its weights, and how fast it is here. The only check that needs PyTorch."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Final

from gcs.doctor.check import Question, Result, Say, fail, ok, skip, warn

_NAME: Final = "tracker"
_UPDATES: Final = 12
_LONGEST_S: Final = 3.0
_GOOD_HZ: Final = 15.0


def tracker(question: Question, say: Say) -> Iterator[Result]:
    """Load the weights, whose checksum is compared then, and time it on pictures of 720p."""
    if question.quick:
        yield skip(_NAME, "not loaded (--quick)")
        return
    say("loading the tracker")
    # PyTorch costs seconds: not for the checks that do without.
    from gcs.tracking import make_tracker
    from tracker.engines.engine import EngineError
    from tracker.online import ClimRTTracker
    from tracker.weights import WeightsError

    choice, began_s = question.config.tracker, time.monotonic()
    try:
        made = make_tracker(choice, say)
    except WeightsError as error:
        yield fail("weights", str(error), "name others: tracker.weights; `gcs weights info FILE` looks at one")
        return
    except EngineError as error:
        yield fail("engine", str(error), "leave out tracker.engine, or name another: torch runs everywhere")
        return
    load_s = time.monotonic() - began_s
    loaded = made.loaded if isinstance(made, ClimRTTracker) else None
    name = choice.weights if loaded is None else f"{loaded.weights} on {loaded.engine}"
    yield ok("weights", f"{name}: checksum right, loaded in {load_s:.1f} s", load_s=load_s)
    say("timing the tracker")
    from gcs.benchmark.films import BOX, frame
    from gcs.benchmark.timing import measure

    frames = [frame(i) for i in range(4)]
    made.init(frames[0], BOX)
    turn = iter(range(10**9))
    update: Callable[[], object] = lambda: made.update(frames[next(turn) % len(frames)])  # noqa: E731
    one_ms = measure(update, 1).wall_ms
    figure = measure(update, max(2, min(_UPDATES, round(1000 * _LONGEST_S / one_ms))))
    yield judge_speed(figure.wall_ms, question.config.control.engagement.target_age_s)


def judge_speed(median_ms: float, target_age_s: float) -> Result:
    """What it means that an update takes so long; target_age_s: older is unseen."""
    fps = 1000.0 / median_ms
    text = f"{median_ms:.0f} ms a picture: {fps:.0f} pictures a second at most"
    fix = "`gcs bench --auto` looks for the fastest way here; end other programs"
    figures = {"update_ms": median_ms, "fps": fps}
    if median_ms / 1000 > target_age_s / 2:  # every second picture alone is older than what is still seen
        return fail(_NAME, f"{text}, too few to follow with", fix, **figures)
    return warn(_NAME, text, fix, **figures) if fps < _GOOD_HZ else ok(_NAME, text, **figures)
