"""YAML into frozen dataclasses, each error naming file, line and key. Knows nothing of what the keys mean.

Several files may be laid over each other: a key of a later one wins, and where each value came from is kept.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_type_hints

import msgspec
import yaml

from gcs.errors import ConfigError, one_line

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a value was written: file and line, from 1."""

    path: Path
    line: int


@dataclass(frozen=True, slots=True)
class Layered(Generic[T]):
    """What the files came to; origins: of the values that are in one of them, by dotted key."""

    value: T
    origins: dict[str, Origin]


@dataclass(frozen=True, slots=True)
class _Layer:
    """One section of one file."""

    path: Path
    node: yaml.Node


def load_layers(paths: Sequence[Path], kind: type[T]) -> Layered[T]:
    """The files as one instance of `kind`, a frozen dataclass all of whose fields have defaults; the last one wins.

    Numbers are held to the field's metadata `low` and `high`. Raises ConfigError, one line.
    """
    roots = [(path, _compose(path, _read(path))) for path in paths]
    origins: dict[str, Origin] = {}
    value = _build(kind, [_Layer(path, root) for path, root in roots if root is not None], "", origins)
    return Layered(value, origins)


def _read(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    if len(data) > MAX_BYTES:
        raise ConfigError(f"{path}: {len(data)} bytes are too many for a configuration file")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not a text file in UTF-8") from error


def _compose(path: Path, text: str) -> yaml.Node | None:
    try:
        _check_shape(path, text)
        return yaml.compose(text, yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{line}: not valid YAML: {error.problem or error.context}") from error
    except (yaml.YAMLError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid YAML: {str(error).splitlines()[0]}") from error


def _check_shape(path: Path, text: str) -> None:
    """Before anything is built of it: PyYAML's time grows with the square of the depth."""
    depth = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        line = event.start_mark.line + 1 if event.start_mark is not None else 0
        if isinstance(event, yaml.AliasEvent):
            raise ConfigError(f"{path}:{line}: YAML aliases (*name) are not supported")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise ConfigError(f"{path}:{line}: nested more than {MAX_DEPTH} deep")


def _build(kind: type[T], layers: Sequence[_Layer], prefix: str, origins: dict[str, Origin]) -> T:
    """One section; `prefix` is the dotted path of its key with a dot at the end. Fills `origins`."""
    hints = get_type_hints(kind)
    metadata = {f.name: f.metadata for f in fields(kind)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    sections: dict[str, list[_Layer]] = {}
    places: dict[str, _Layer] = {}  # where each key was written last
    for layer in layers:
        for key, key_node, value_node in _items(layer, metadata, prefix):
            places[key] = _Layer(layer.path, key_node)
            if is_dataclass(hints[key]):
                sections.setdefault(key, []).append(_Layer(layer.path, value_node))
            else:
                values[key] = _leaf(hints[key], value_node, layer.path, prefix + key, metadata[key])
                origins[prefix + key] = Origin(layer.path, key_node.start_mark.line + 1)
    for key, parts in sections.items():
        values[key] = _build(hints[key], parts, f"{prefix}{key}.", origins)
    try:
        return kind(**values)
    except ValueError as error:
        at = next((k for k in places if re.search(rf"\b{re.escape(k)}\b", str(error))), None)
        place = places[at] if at else layers[-1]  # without a key there is no error: defaults are valid
        raise _error(place.path, place.node, prefix[:-1] or "the file", str(error)) from error


def _items(layer: _Layer, known: dict[str, Any], prefix: str) -> list[tuple[str, yaml.Node, yaml.Node]]:
    """(key, its node, its value's node) of a section; each key known, and given once."""
    path, node = layer.path, layer.node
    if not isinstance(node, yaml.MappingNode):
        if isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null":
            return []  # a section all of whose keys are commented out
        raise _error(path, node, prefix[:-1] or "the file", "must be a list of `key: value` lines")
    items: dict[str, tuple[str, yaml.Node, yaml.Node]] = {}
    for key_node, value_node in node.value:
        key = str(key_node.value)
        if key not in known:
            raise _error(path, key_node, prefix + key, "unknown key" + _suggestion(key, known))
        if key in items:
            raise _error(path, key_node, prefix + key, "given twice")
        items[key] = (key, key_node, value_node)
    return list(items.values())


def _leaf(hint: Any, node: yaml.Node, path: Path, name: str, metadata: Any) -> Any:
    """A single value, of the field's type and within its range."""
    raw = _plain(node, path, name)
    if isinstance(raw, bool) and _enum_of(hint) and isinstance(node, yaml.ScalarNode):
        raw = node.value  # YAML reads a bare `off` as false
    try:
        value = msgspec.convert(raw, hint, strict=True)
    except msgspec.ValidationError as error:
        raise _error(path, node, name, _readable(str(error), hint)) from error
    wrong = _beyond(value, metadata)
    if wrong:
        raise _error(path, node, name, wrong)
    return value


def _beyond(value: Any, metadata: Any) -> str:
    """What is wrong with a value of the right type, empty where nothing is."""
    low, high = metadata.get("low"), metadata.get("high")
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, float) and not math.isfinite(number):
            return "must be a finite number"
        if low is not None and isinstance(number, int | float) and not low <= number <= high:
            return f"must be from {low:g} to {high:g}, not {number:g}"
    return ""


def check_ranges(values: Any, prefix: str = "") -> None:
    """ValueError where a configuration that was not read from a file has a value that no file may hold."""
    for each in fields(values):
        value = getattr(values, each.name)
        if is_dataclass(value):
            check_ranges(value, f"{prefix}{each.name}.")
        elif wrong := _beyond(value, each.metadata):
            raise ValueError(f"{prefix}{each.name}: {wrong}")


def _plain(node: yaml.Node, path: Path, name: str) -> Any:
    """The node as None, bool, number, text or a flat list of these; nothing else may stand in the file."""
    if isinstance(node, yaml.SequenceNode):
        return [_plain(item, path, name) for item in node.value]
    if not isinstance(node, yaml.ScalarNode):
        raise _error(path, node, name, "must be a single value")
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_object(node)
    # What PyYAML lets out for an explicit tag that does not fit: `!!int ''`, `!!bool x`, `!!timestamp x`.
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError) as error:
        raise _error(path, node, name, "is not a value this file may hold") from error
    finally:
        loader.dispose()


def _suggestion(key: str, known: Any) -> str:
    close = difflib.get_close_matches(key, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else f" (known here: {', '.join(known)})"


def _readable(message: str, hint: Any) -> str:
    text = message.split(" - at `")[0].replace("`", "")
    kind = _enum_of(hint)
    if kind is not None:
        text += f" (known: {', '.join(str(member.value) for member in kind)})"
    return text[0].lower() + text[1:]


def _enum_of(hint: Any) -> type[Enum] | None:
    """The enumeration in a hint such as `Latent` or `Latent | None`."""
    kinds = (kind for kind in (hint, *get_args(hint)) if isinstance(kind, type))
    return next((kind for kind in kinds if issubclass(kind, Enum)), None)


def _error(path: Path, node: yaml.Node, name: str, message: str) -> ConfigError:
    return ConfigError(one_line(f"{path}:{node.start_mark.line + 1}: {name}: {message}"))
