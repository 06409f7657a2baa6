"""YAML into frozen dataclasses, each error naming file, line and key. Knows nothing of what the keys mean."""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import yaml

from gcs.errors import ConfigError, one_line

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16

T = TypeVar("T")


def load_dataclass(path: Path, kind: type[T]) -> T:
    """The file as an instance of `kind`, a frozen dataclass all of whose fields have defaults.

    Numbers are held to the field's metadata `low` and `high`. Raises ConfigError, one line.
    """
    root = _compose(path, _read(path))
    return _build(kind, root, path, "") if root is not None else kind()


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


def _build(kind: type[T], node: yaml.Node, path: Path, prefix: str) -> T:
    """One section; `prefix` is the dotted path of its key with a dot at the end."""
    if not isinstance(node, yaml.MappingNode):
        if isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null":
            return kind()  # a section all of whose keys are commented out
        raise _error(path, node, prefix[:-1] or "the file", "must be a list of `key: value` lines")
    hints = get_type_hints(kind)
    metadata = {f.name: f.metadata for f in fields(kind)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    lines: dict[str, yaml.Node] = {}
    for key_node, value_node in node.value:
        key = str(key_node.value)
        name = prefix + key
        if key not in metadata:
            raise _error(path, key_node, name, "unknown key" + _suggestion(key, metadata))
        if key in values:
            raise _error(path, key_node, name, "given twice")
        lines[key] = key_node
        if is_dataclass(hints[key]):
            values[key] = _build(hints[key], value_node, path, name + ".")
        else:
            values[key] = _leaf(hints[key], value_node, path, name, metadata[key])
    try:
        return kind(**values)
    except ValueError as error:
        at = next((k for k in lines if re.search(rf"\b{re.escape(k)}\b", str(error))), None)
        raise _error(path, lines[at] if at else node, prefix[:-1] or "the file", str(error)) from error


def _leaf(hint: Any, node: yaml.Node, path: Path, name: str, metadata: Any) -> Any:
    """A single value, of the field's type and within its range."""
    raw = _plain(node, path, name)
    if isinstance(raw, bool) and _enum_of(hint) and isinstance(node, yaml.ScalarNode):
        raw = node.value  # YAML reads a bare `off` as false
    try:
        value = msgspec.convert(raw, hint, strict=True)
    except msgspec.ValidationError as error:
        raise _error(path, node, name, _readable(str(error), hint)) from error
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, float) and not math.isfinite(number):
            raise _error(path, node, name, "must be a finite number")
        low, high = metadata.get("low"), metadata.get("high")
        if low is not None and isinstance(number, int | float) and not low <= number <= high:
            raise _error(path, node, name, f"must be from {low:g} to {high:g}, not {number:g}")
    return value


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
