"""Which engines there are, which of them can run here, and how one is made."""

from __future__ import annotations

from typing import Final

from tracker.engines.eager import EagerEngine
from tracker.engines.engine import Engine, EngineError
from tracker.network.climrt import ClimRT

TORCH: Final = "torch"
ENGINES: Final = (TORCH,)


def available_engines() -> list[str]:
    """Those whose package, or device, is there."""
    return [TORCH]


def make_engine(name: str, network: ClimRT, threads: int | None = None) -> Engine:
    """By its name, for a network on the CPU; threads: of an engine that brings its own. EngineError, one line."""
    match name:
        case "torch":
            return EagerEngine(network)
        case _:
            raise EngineError(f"engine {name}: none of {', '.join(ENGINES)}")
