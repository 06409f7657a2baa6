"""The video: does it open, how soon, how regularly do its pictures come."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.doctor.check import Question, Result, Say, fail, ok, skip, warn
from gcs.errors import VideoError
from gcs.video import open_source
from gcs.video.frame import redact

_SLOW_FIRST_S: Final = 3.0
_LOW_HZ, _TOO_LOW_HZ = 10.0, 5.0
_UNEVEN: Final = 0.5  # of the time between two pictures


@dataclass(frozen=True, slots=True)
class Watched:
    """What was seen of a live video. arrivals_s: of its pictures. codec: empty where it is not known."""

    first_s: float
    size: tuple[int, int]
    nominal_fps: float
    arrivals_s: Sequence[float]
    decode_s: float
    codec: str = ""


def video(question: Question, say: Say) -> Iterator[Result]:
    """Open it and watch it for a while."""
    if question.video is None:
        yield skip("video", "not looked at: give --video URL, --profile or --config")
        return
    say(f"video: waiting for the first picture of {redact(question.video)}")
    began_s = time.monotonic()
    try:
        source = open_source(question.video, reconnect=False)
    except VideoError as error:
        yield fail("video", str(error), "does `ffplay URL` show it? then check address, network and firewall")
        return
    first_s = time.monotonic() - began_s
    try:
        if not source.is_live:
            fix = f"use `gcs dry-run {question.video}`, or give a live video"
            yield warn("video", f"{source.size[0]}x{source.size[1]} px, recorded: it cannot fly a vehicle", fix)
            return
        say(f"video: watching it for {question.watch_s:g} s")
        arrivals_s, decodes_s = [], []
        ends_s = time.monotonic() + question.watch_s
        while (left_s := ends_s - time.monotonic()) > 0 and not source.ended:
            frame = source.read(left_s)
            if frame is not None:
                arrivals_s.append(frame.t_arrival_s)
                decodes_s.append(frame.decode_s)
        decode_s = statistics.median(decodes_s) if decodes_s else 0.0
        codec = str(getattr(source, "codec", "") or "")
        watched = Watched(first_s, source.size, source.fps or 0.0, arrivals_s, decode_s, codec)
        broke = getattr(source, "problem", None)
    finally:
        source.close()
    yield from judge_video(watched, str(broke) if broke else None)


def judge_video(watched: Watched, broke: str | None = None) -> Iterator[Result]:
    """What it means; broke: why it ended while it was watched."""
    width, height = watched.size
    codec = f", {watched.codec}" if watched.codec else ""
    text = f"{width}x{height} px{codec}; first picture after {watched.first_s:.1f} s"
    figures = {"first_s": watched.first_s, "width_px": float(width), "height_px": float(height)}
    if watched.first_s > _SLOW_FIRST_S:
        fix = "send key frames more often (every second): nothing can be shown before one"
        yield warn("video", text, fix, **figures)
    else:
        yield ok("video", text, **figures)
    if broke is not None:
        yield fail(
            "video rate", f"broke off: {broke}", "is the network good enough? RTSP over TCP is asked for already"
        )
    else:
        yield _rate(watched)


def _rate(watched: Watched) -> Result:
    """Pictures a second, and how evenly."""
    gaps_s = [later - earlier for earlier, later in zip(watched.arrivals_s, watched.arrivals_s[1:], strict=False)]
    if len(gaps_s) < 3:
        text = f"{len(watched.arrivals_s)} pictures came in all"
        return fail("video rate", text, "does the camera send on? is another program reading it?")
    fps, usual_s = 1 / statistics.mean(gaps_s), statistics.median(gaps_s)
    jitter_s = statistics.pstdev(gaps_s)
    figures = {
        "fps": fps, "jitter_s": jitter_s, "longest_gap_s": max(gaps_s), "decode_s": watched.decode_s,
    }  # fmt: skip
    text = (
        f"{fps:.1f} pictures a second, uneven by {1000 * jitter_s:.0f} ms (longest gap {1000 * max(gaps_s):.0f} ms), "
        f"decoded in {1000 * watched.decode_s:.1f} ms"
    )
    if fps < _TOO_LOW_HZ:
        return fail("video rate", text, "set a higher rate at the camera: 15 or more, 30 is good", **figures)
    if fps < _LOW_HZ:
        return warn("video rate", text, "set a higher rate at the camera: 30 is good", **figures)
    if jitter_s > _UNEVEN * usual_s:
        fix = "a wired network, a smaller picture or a lower bit rate makes it more even; no B frames"
        return warn("video rate", text, fix, **figures)
    return ok("video rate", text, **figures)
