"""The example configuration, made from the defaults themselves so that it can never lie about them."""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, get_args, get_type_hints

import yaml

from gcs.config import Config

HEAD = """\
# Every key of the configuration with its default and its range; leave out what you do not change.
# Unknown keys and values out of range are refused with file, line and key. null means: not set.
# Made by `gcs config`.
"""


def render(config: Config | None = None) -> str:
    """A configuration, the defaults if not said, as YAML text with every key; loading it gives the same again."""
    return HEAD + "".join(_section(config or Config(), 0))


def _section(values: Any, depth: int) -> list[str]:
    indent = "  " * depth
    lines: list[str] = []
    hints = get_type_hints(type(values))
    for f in fields(values):
        value = getattr(values, f.name)
        if is_dataclass(value):
            comment = textwrap.dedent("    " + (value.__doc__ or "")).strip()
            comment = re.sub(r"\s*ValueError[^.]*\.", "", comment)
            lines.append("\n" + textwrap.indent(comment, f"{indent}# ", lambda line: True).replace("# \n", "#\n"))
            lines.append(f"\n{indent}{f.name}:\n")
            lines += _section(value, depth + 1)
        else:
            lines.append(f"{indent}{f.name}: {_scalar(value)}{_remark(hints[f.name], f.metadata)}\n")
    return lines


def _scalar(value: Any) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case Enum():
            return str(value.value)
        case tuple():
            return "[" + ", ".join(_scalar(item) for item in value) + "]"
        case str():
            return value if yaml.safe_load(value) == value else json.dumps(value)
        case _:
            return repr(value) if isinstance(value, float) else str(value)


def _remark(hint: Any, metadata: Any) -> str:
    """The range, or the choices of an enumeration, as a comment."""
    for kind in (hint, *get_args(hint)):
        if isinstance(kind, type) and issubclass(kind, Enum):
            return "  # one of " + ", ".join(_scalar(member) for member in kind)
    if "low" in metadata:
        return f"  # from {metadata['low']:g} to {metadata['high']:g}"
    return ""
