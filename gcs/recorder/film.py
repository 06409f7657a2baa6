"""The film of a flight: what the camera sent, as it came."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Film:
    """on: the operator's switch."""

    on: bool = True
    dropped: int = 0
    problem: str | None = None

    def close(self) -> None:
        """Finish the files."""
