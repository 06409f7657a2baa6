"""What a recorded flight came to, as figures; filled by `gcs.report.tally` in one pass over its messages.

Times t_s, start_s and end_s are seconds since the first message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

IMPORT: Final = "import"


@dataclass(frozen=True, slots=True)
class Event:
    """A line of the timeline. kind: state, operator, vehicle, tracker or video."""

    t_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Phase:
    """From one change of state to the next. name: of the state, or engaging; reasons: in the operator's words."""

    start_s: float
    end_s: float
    name: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Of one part of the latency, ms."""

    median_ms: float
    p95_ms: float
    p99_ms: float


@dataclass(frozen=True, slots=True)
class Follow:
    """From the moment the vehicle was ours to the end. ended: the state that came, with its reasons."""

    start_s: float
    end_s: float
    mode: str
    standoff_m: float | None
    ended: str


@dataclass(frozen=True, slots=True)
class Loss:
    """The target was not seen while it was followed. found: it was followed again by itself."""

    start_s: float
    end_s: float
    found: bool


@dataclass(frozen=True, slots=True)
class Following:
    """While a target was followed, seen or not; None: there was none, or the messages do not tell.

    bearing: the target off the middle of the picture, horizontally. distance: over the standoff, as the station
    believed it. reacquired: of the losses, those after which it was followed again by itself. longest_gap_s: between
    two setpoints that were sent.
    """

    confirmations: int
    seen_s: float
    unseen_s: float
    losses: int
    reacquired: int
    longest_loss_s: float
    bearing_rms_deg: float | None
    distance_rms_frac: float | None
    longest_gap_s: float | None = None


@dataclass(frozen=True, slots=True)
class Clipped:
    """A limit, or the gate, that took something away while following. spans: from, to (s)."""

    name: str
    total_s: float
    spans: tuple[tuple[float, float], ...]


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
class Parameter:
    """One finding of the audit, in words."""

    name: str
    value: float | None
    wanted: str
    level: str
    why: str
    accepted: bool


@dataclass(frozen=True, slots=True)
class Audited:
    """The newest judgement of the vehicle's parameters: how many of each, and what was said of those not fine."""

    autopilot: str
    fine: int
    advice: int
    unsafe: int
    said: tuple[str, ...]
    parameters: tuple[Parameter, ...] = ()


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator ordered, and the answer."""

    t_s: float
    order: str
    answer: str
    refused: bool


@dataclass(frozen=True, slots=True)
class Standing:
    """Everything that would have kept a confirmation from being accepted, from then on."""

    t_s: float
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Words:
    """A line for the operator. by: station or vehicle."""

    t_s: float
    by: str
    text: str


@dataclass(frozen=True, slots=True)
class Changed:
    """A configuration value that is not the default."""

    key: str
    value: str
    default: str


@dataclass(frozen=True, slots=True)
class Provenance:
    """What it was flown with, from the manifest; empty where there is none. simulated: no real vehicle flew.

    video_size_px: (width, height) of its pictures.
    """

    kind: str = ""
    simulated: bool = False
    vehicle: str = ""
    video: str = ""
    video_size_px: tuple[int, int] | None = None
    weights: str = ""
    weights_sha256: str = ""
    seed: int | None = None
    software: dict[str, str] = field(default_factory=dict)
    machine: dict[str, str] = field(default_factory=dict)
    changed: tuple[Changed, ...] = ()

    @property
    def is_import(self) -> bool:
        """Another station flew it: nothing in it was decided here."""
        return self.kind == IMPORT


@dataclass(frozen=True, slots=True)
class Report:
    """The whole. began: local time. limits_s: how long each limit clipped. verdict: in sentences.

    battery_frac: at the start and at the end; None: not told.
    """

    folder: str
    began: str
    lasted_s: float
    autopilot: str | None
    frames: int
    fps: float
    timeline: tuple[Event, ...]
    following: Following
    latency_ms: dict[str, Percentiles]
    limits_s: dict[str, float]
    link: Link | None
    audit: Audited | None
    longest_pause_s: float
    problems: tuple[str, ...]
    phases: tuple[Phase, ...] = ()
    follows: tuple[Follow, ...] = ()
    losses: tuple[Loss, ...] = ()
    clipped: tuple[Clipped, ...] = ()
    orders: tuple[Order, ...] = ()
    refusals: tuple[Standing, ...] = ()
    said: tuple[Words, ...] = ()
    battery_frac: tuple[float, float] | None = None
    provenance: Provenance = field(default_factory=Provenance)
    verdict: tuple[str, ...] = ()
