"""What a recorded flight came to, as figures; filled by `gcs.report.tally` in one pass over its messages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Event:
    """A line of the timeline. t_s: since the first message. kind: state, operator, vehicle or video."""

    t_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Spread:
    """Of one part of the latency, ms."""

    median_ms: float
    p95_ms: float


@dataclass(frozen=True, slots=True)
class Following:
    """While a target was followed, seen or not; None: there was none, or the messages do not tell.

    bearing: the target off the middle of the picture, horizontally. distance: over the standoff, as the station
    believed it. reacquired: of the losses, those after which it was followed again by itself.
    """

    confirmations: int
    seen_s: float
    unseen_s: float
    losses: int
    reacquired: int
    longest_loss_s: float
    bearing_rms_deg: float | None
    distance_rms_frac: float | None


@dataclass(frozen=True, slots=True)
class Link:
    """Over the flight."""

    received_kbps: float
    sent_kbps: float
    most_loss_frac: float
    bad_frames: int
    setpoints_sent: int
    dropped_late: int


@dataclass(frozen=True, slots=True)
class Audited:
    """The newest judgement of the vehicle's parameters: how many of each, and what was said of those not fine."""

    autopilot: str
    fine: int
    advice: int
    unsafe: int
    said: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """The whole. began: local time, as the files tell it. limits_s: how long each limit clipped."""

    folder: str
    began: str
    lasted_s: float
    autopilot: str | None
    frames: int
    fps: float
    timeline: tuple[Event, ...]
    following: Following
    latency_ms: dict[str, Spread]
    limits_s: dict[str, float]
    link: Link | None
    audit: Audited | None
    longest_pause_s: float
    problems: tuple[str, ...]
