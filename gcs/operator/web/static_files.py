"""The page's own files: read once, served from memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

FOLDER: Final = Path(__file__).with_name("static")
_TYPES: Final = MappingProxyType(
    {
        ".html": "text/html",
        ".js": "text/javascript",
        ".css": "text/css",
        ".svg": "image/svg+xml",
        ".png": "image/png",
        ".json": "application/json",
        ".webmanifest": "application/manifest+json",
    }
)


@dataclass(frozen=True, slots=True)
class StaticFile:
    """One of them; type: of its content."""

    type: str
    body: bytes

    @property
    def is_text(self) -> bool:
        """It has a character set."""
        return not self.type.startswith("image/png")


def read_all(folder: Path = FOLDER) -> dict[str, StaticFile]:
    """By name; nothing outside the folder can be asked for, as only these names are known."""
    return {
        path.name: StaticFile(_TYPES[path.suffix], path.read_bytes())
        for path in sorted(folder.glob("*"))
        if path.suffix in _TYPES
    }
