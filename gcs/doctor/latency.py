"""From light to command, out of what the other checks have measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.doctor.check import Question, Result, fail, ok, skip, warn

_NAME: Final = "latency"
_TICK_WAIT_S: Final = 0.025  # half a period of the control task, on average
_LITTLE_LEFT: Final = 0.75  # of what is allowed


def latency(question: Question, measured: Mapping[str, Mapping[str, float]]) -> Result:
    """measured: the figures of each check by its name."""
    video, tracker = measured.get("video rate", {}), measured.get("tracker", {})
    if not video or not tracker:
        return skip(_NAME, "needs a video, and the tracker timed")
    known = question.config.camera.glass_delay_s
    parts_s = {
        "camera and network" + (" (assumed)" if known is None else ""): question.config.camera.assumed_glass_delay_s,
        "decoding": video["decode_s"],
        "waiting for the tracker": max(0.0, tracker["update_ms"] / 1000 - 1 / video["fps"]) / 2,
        "tracker": tracker["update_ms"] / 1000,
        "waiting for the tick": _TICK_WAIT_S,
        "link": measured.get("round trip", {}).get("round_trip_s", 0.0) / 2,
    }
    total_s, most_s = sum(parts_s.values()), question.config.control.engagement.max_latency_s
    said = ", ".join(f"{name} {1000 * part_s:.0f}" for name, part_s in parts_s.items() if part_s >= 0.001)
    text = f"about {1000 * total_s:.0f} of {1000 * most_s:.0f} ms allowed: {said}"
    fix = "shorten the largest of these"
    if total_s > most_s:
        return fail(_NAME, text, fix, total_s=total_s)
    return (
        warn(_NAME, text, fix, total_s=total_s) if total_s > _LITTLE_LEFT * most_s else ok(_NAME, text, total_s=total_s)
    )
