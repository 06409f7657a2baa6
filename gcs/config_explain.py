"""Each value of a configuration with its unit, range, meaning, and where it comes from."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Final, get_args, get_type_hints

from gcs.config import Config
from gcs.config_yaml import Origin
from gcs.profiles import profile_of

DEFAULT: Final = "default"
COMMAND_LINE: Final = "command line"
_UNITS: Final = {
    "_mps2": "m/s2", "_rps2": "rad/s2", "_mps": "m/s", "_rps": "rad/s", "_rad": "rad", "_deg": "deg", "_px": "px",
    "_hz": "Hz", "_frac": "of 1", "_kbps": "kbit/s", "_mb": "MB", "_ps": "1/s", "_s": "s", "_m": "m", "fps": "1/s",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Explained:
    """One value. key: dotted. choices: of an enumeration. source: DEFAULT, COMMAND_LINE, FILE:LINE, profile NAME:LINE.

    meaning: as the program's own text says it, empty where the name says all.
    """

    key: str
    value: Any
    default: Any
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    source: str
    meaning: str

    @property
    def is_changed(self) -> bool:
        """It is not what it is by itself."""
        return bool(self.value != self.default)

    def as_json(self) -> dict[str, Any]:
        """Of JSON's own kinds."""
        row = {name: getattr(self, name) for name in ("key", "value", "default", "unit", "low", "high")}
        return {**row, "choices": list(self.choices), "source": self.source, "meaning": self.meaning}


def explain(config: Config, written: Config, origins: Mapping[str, Origin]) -> list[Explained]:
    """All values, in order. written: as the files of `origins` say; what differs in `config` is the command line's."""
    rows = []
    hints = cache(get_type_hints)
    comments = cache(_comments)
    for (key, field, kind, value), (_, _, _, before), (_, _, _, default) in zip(
        _leaves(config), _leaves(written), _leaves(Config()), strict=True
    ):
        origin = origins.get(key)
        source = COMMAND_LINE if value != before else DEFAULT if origin is None else _place(origin)
        if key == "page.token" and value is not None:
            value = "(secret)"
        low, high = field.metadata.get("low"), field.metadata.get("high")
        unit = next((unit for end, unit in _UNITS.items() if field.name.endswith(end)), "")
        meaning = _said(kind, field.name) or comments(kind).get(field.name, "")
        choices = _choices(hints(kind)[field.name])
        rows.append(Explained(key, _plain(value), _plain(default), unit, low, high, choices, source, meaning))
    return rows


def keys() -> list[str]:
    """All there are."""
    return [key for key, _, _, _ in _leaves(Config())]


def chosen(rows: Sequence[Explained], keys: Sequence[str]) -> list[Explained]:
    """Those of a key or below it; all for no keys."""
    return [row for row in rows if not keys or any(is_of(row.key, key) for key in keys)]


def is_of(key: str, part: str) -> bool:
    """Whether a key is this one, or below it in the tree."""
    return key == part or key.startswith(f"{part}.")


def in_words(row: Explained) -> str:
    """The value with its unit; an angle in degrees as well."""
    unit = f" {row.unit}" if row.unit and row.value is not None else ""
    degrees = ""
    if row.unit.startswith("rad") and isinstance(row.value, float):
        degrees = f" ({math.degrees(row.value):.4g} deg{row.unit[3:]})"
    return f"{shown(row.value)}{unit}{degrees}"


def shown(value: Any) -> str:
    """As in a file, but short."""
    match value:
        case None:
            return "not set"
        case bool():
            return "true" if value else "false"
        case float():
            return f"{value:.6g}"
        case list():
            return f"[{', '.join(map(shown, value))}]"
        case _:
            return str(value)


def _leaves(section: Any, prefix: str = "") -> Iterator[tuple[str, Field[Any], type, Any]]:
    """(key, field, its dataclass, value) of everything that is no section."""
    for field in fields(section):
        value = getattr(section, field.name)
        if is_dataclass(value):
            yield from _leaves(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, field, type(section), value


def _plain(value: Any) -> Any:
    """Of JSON's own kinds."""
    if isinstance(value, Enum):
        return value.value
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _choices(hint: Any) -> tuple[str, ...]:
    kinds = (kind for kind in (hint, *get_args(hint)) if isinstance(kind, type) and issubclass(kind, Enum))
    return tuple(str(member.value) for kind in kinds for member in kind)


def _place(origin: Origin) -> str:
    profile = profile_of(origin.path)
    return f"{origin.path if profile is None else f'profile {profile}'}:{origin.line}"


def _said(kind: type, name: str) -> str:
    """What the class's docstring says after `name:`."""
    text = " ".join((kind.__doc__ or "").split())
    names = "|".join(field.name for field in fields(kind))
    found = re.search(rf"\b{name}: (.*?)(?=\s\b(?:{names})\b[^.:;]{{0,20}}:\s|$)", text)
    return re.sub(r"\s*ValueError[^.]*\.", "", found.group(1)).strip(" .;,") if found else ""


def _comments(kind: type) -> dict[str, str]:
    """What stands behind each field in its source; nothing where that is not installed."""
    try:
        source = inspect.getsource(kind)
    except OSError:
        return {}
    return dict(re.findall(r"^    (\w+): .*?  # (.*)$", source, re.MULTILINE))
