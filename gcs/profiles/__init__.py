"""Ready-made configurations, laid under your own file: `--profile NAME`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from gcs.errors import ConfigError

_FOLDER: Final = Path(__file__).parent


def profile_names() -> list[str]:
    """Those that ship."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def profile_path(name: str) -> Path:
    """The file of a profile; ConfigError says which there are."""
    if name not in profile_names():
        raise ConfigError(f"no profile {name!r}; there are: {', '.join(profile_names())}")
    return _FOLDER / f"{name}.yaml"


def profile_text(name: str) -> str:
    """What it is for: the first comment of its file."""
    return profile_path(name).read_text(encoding="utf-8").splitlines()[0].lstrip("# ")


def profile_of(path: Path) -> str | None:
    """The profile that a file is, None for a file of the user's."""
    return path.stem if path.parent == _FOLDER else None
