"""Reading a scenario's JSON key by key, so that a mistake is named with its place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any


class ScenarioError(ValueError):
    """A scenario is not known or its file is wrong; the text says where."""


class Fields:
    """A JSON object read key by key, so that a missing, mistyped or unknown key is named."""

    def __init__(self, content: Any, where: str) -> None:
        if not isinstance(content, dict):
            raise ScenarioError(f"{where}: must be an object")
        self._content, self._where = dict(content), where

    def text(self, key: str, default: str | None = None) -> str:
        """A string."""
        value = self._content.pop(key, default)
        if not isinstance(value, str):
            raise ScenarioError(f"{self._where}.{key}: must be a string")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number."""
        return self._number(self._content.pop(key, default), key)

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """A list of `count` finite numbers."""
        value = self._content.pop(key, default)
        if not isinstance(value, (list, tuple)) or len(value) != count:
            raise ScenarioError(f"{self._where}.{key}: must be a list of {count} numbers")
        return tuple(self._number(item, key) for item in value)

    def pairs(self, key: str) -> tuple[tuple[float, float], ...]:
        """A list of pairs of numbers."""
        value = self._content.pop(key, [])
        if not isinstance(value, list) or any(not isinstance(p, list) or len(p) != 2 for p in value):
            raise ScenarioError(f"{self._where}.{key}: must be a list of pairs")
        return tuple((self._number(a, key), self._number(b, key)) for a, b in value)

    def objects(self, key: str) -> Iterator[Fields]:
        """A list of objects."""
        value = self._content.pop(key, [])
        if not isinstance(value, list):
            raise ScenarioError(f"{self._where}.{key}: must be a list")
        for i, item in enumerate(value):
            yield Fields(item, f"{self._where}.{key}[{i}]")

    def child(self, key: str) -> Fields | None:
        """An object, if it is there."""
        return Fields(self._content.pop(key), f"{self._where}.{key}") if key in self._content else None

    def done(self) -> None:
        """Refuse keys that nobody asked for."""
        if self._content:
            raise ScenarioError(f"{self._where}: unknown key {', '.join(sorted(self._content))}")

    def _number(self, value: Any, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ScenarioError(f"{self._where}.{key}: must be a number")
        return float(value)
