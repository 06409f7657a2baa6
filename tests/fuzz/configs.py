"""Configurations that nobody should write, by hypothesis: either a `Config`, or one line that says what is wrong."""

from __future__ import annotations

import gc
import math
import random
import string
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from gcs.config import Config, load
from gcs.config_example import render
from gcs.errors import ConfigError, one_line
from tests.fuzz.process import Usage
from tests.fuzz.report import Progress, Row

_WARM_FRAC: Final = 0.2
_GROWTH_MB: Final = 20.0
_ROUND: Final = 250


@dataclass(frozen=True, slots=True)
class Text:
    """A file's bytes; key: the only one that can be wrong in it, if that is known."""

    data: bytes
    key: str = ""


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        """Everything is written out: an alias would be refused before what it stands for is looked at."""
        return True


def _dump(tree: Any) -> str:
    return str(yaml.dump(tree, Dumper=_Dumper))


def keys_of(values: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every key of a configuration, sections and leaves."""
    for field in fields(values):
        here = (*path, field.name)
        yield here
        if is_dataclass(getattr(values, field.name)):
            yield from keys_of(getattr(values, field.name), here)


_DEFAULTS: Final = yaml.safe_load(render())
KEYS: Final = tuple(keys_of(Config()))
_ABSURD: Final = st.sampled_from(
    [None, True, False, 0, -1, 1e-320, 1e308, math.nan, math.inf, -math.inf, 10**30, "", "on", "~", "nan", "1e3",
     "\x00", "x" * 5000, "\u202e\n", [], [[]], [1, 2, 3], [None] * 3, [math.nan] * 3, {}, {"a": 1}, [{}],
     "2001-01-01", "0x10"]
)  # fmt: skip
_values = st.recursive(
    _ABSURD | st.floats() | st.integers() | st.text(max_size=20) | st.booleans(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
_names = st.sampled_from([key[-1] for key in KEYS]) | st.text(alphabet=string.printable, max_size=12)
_RAW: Final = st.sampled_from(
    ["&a [*a]", "*a", "!!python/object/apply:os.system [echo]", "!!binary aGk=", "{<<: {x: 1}}", "? [a]\n: b",
     "--- 1\n--- 2", "- " * 900, "[" * 200_000, "{" * 200_000, "%YAML 9.9\n---", "\ufeffvideo:", "a: |\n  b\n c",
     "\t x: 1",
     "key: 'unfinished", "!!set {a}", "!!float x", "!!int ''", "!!bool x", "!!timestamp x", "!!timestamp 2001-99-99",
     "9" * 5000, "-.inf", ".nan", "0b2", "1_0:99:99"]
)  # fmt: skip


@st.composite
def _changed(draw: st.DrawFn) -> Text:
    """A good file in which one key, or a few, hold something else."""
    tree: dict[str, Any] = {}
    paths = draw(st.lists(st.sampled_from(KEYS), min_size=1, max_size=3))
    for path in paths:
        section = tree
        for name in path[:-1]:
            inner = section.setdefault(name, {})
            section = inner if isinstance(inner, dict) else {}
        section[path[-1]] = draw(_values | st.just(_default(path)))
    return Text(_dump(tree).encode(), paths[0][-1] if len(paths) == 1 else "")


def _default(path: tuple[str, ...]) -> Any:
    value: Any = _DEFAULTS
    for name in path:
        value = value[name]
    return value


@st.composite
def _any_tree(draw: st.DrawFn) -> str:
    sections = st.dictionaries(_names, _values, max_size=4) | _values
    return _dump(draw(st.dictionaries(_names, sections, max_size=4)))


@st.composite
def _damaged_example(draw: st.DrawFn) -> bytes:
    """The example with lines doubled, lost, cut, indented or noisy."""
    lines = render().splitlines()
    rng = random.Random(draw(st.integers(0, 1 << 32)))
    for _ in range(rng.choice((1, 2, 10))):
        at = rng.randrange(len(lines))
        line = lines[at]
        lines[at : at + 1] = rng.choice(
            (
                [],
                [line, line],
                [line[: rng.randrange(len(line) + 1)]],
                ["  " + line],
                [line + rng.choice(":#'\"{[*&!\x07")],
            )
        )
    data = bytearray("\n".join(lines).encode())
    for _ in range(rng.choice((0, 0, 1, 5))):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


TEXTS: Final = st.one_of(
    _changed(),
    _any_tree().map(lambda text: Text(text.encode())),
    _damaged_example().map(Text),
    _RAW.map(lambda text: Text(text.encode())),
    st.tuples(st.sampled_from(KEYS), _RAW).map(lambda pair: Text(_nested(pair[0], pair[1]).encode())),
    st.text().map(lambda text: Text(text.encode("utf-8", "surrogatepass"))),
    st.binary(max_size=200).map(Text),
)


def _nested(path: tuple[str, ...], text: str) -> str:
    head = "".join(f"{'  ' * depth}{name}:\n" for depth, name in enumerate(path[:-1]))
    return f"{head}{'  ' * (len(path) - 1)}{path[-1]}: {text}\n"


def fuzz_configs(count: int, number: int, folder: Path, *, quiet: bool = True) -> Row:
    """Load `count` of them; number: the seed."""
    row, progress, path = Row("configurations"), Progress("configurations", count, quiet), folder / "my.yaml"
    good, warm = 0, None

    def check(text: Text) -> None:
        nonlocal good
        row.count += 1
        path.write_bytes(text.data)
        problem = try_config(path, text.key)
        good += problem is None
        if problem:
            row.problem(f"{problem} for {text.data[:200]!r}")
        progress.at(row.count)

    for start in range(0, count, _ROUND):
        _examples(check, min(_ROUND, count - start), number + start)
        gc.collect()
        if warm is None and row.count >= _WARM_FRAC * count:
            warm = Usage.now()
    end = Usage.now()
    warm = warm or end
    row.seconds, row.rss_warm_mb, row.rss_end_mb = progress.seconds, warm.rss_mb, end.rss_mb
    row.note = f"{good} good, {row.count - good} refused in one line that names file and key"
    if end.rss_mb - warm.rss_mb > _GROWTH_MB:
        row.problem(f"memory grew from {warm.rss_mb:.1f} to {end.rss_mb:.1f} MB")
    if count > 100 and not 0 < good < row.count:
        row.problem("all came out alike: nothing was put to the test")
    return row


def _examples(check: Callable[[Text], None], count: int, number: int) -> None:
    """One round: hypothesis remembers every example until it ends, and that memory is not the one in question."""
    settled = settings(
        max_examples=count, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    seed(number)(settled(given(TEXTS)(check)))()


def try_config(path: Path, key: str) -> str | None:
    """None: a Config came of it. Empty: one good line did, with the key in it, if any. Else what is wrong."""
    try:
        config = load(path)
    except ConfigError as error:
        text = str(error)
        if text != one_line(text):
            return f"not one line: {text!r}"
        return "" if text.startswith(str(path)) and key in text else f"does not name file and key: {text!r}"
    except BaseException as error:  # noqa: BLE001 - this is what is looked for
        return f"{type(error).__name__} leaves load: {one_line(error)}"
    return "".join(f"{name} is {value}; " for name, value in _numbers(config) if not math.isfinite(value)) or None


def _numbers(values: Any, path: str = "") -> Iterator[tuple[str, float]]:
    for field in fields(values):
        value, name = getattr(values, field.name), f"{path}{field.name}"
        if is_dataclass(value):
            yield from _numbers(value, f"{name}.")
        elif not isinstance(value, Enum):
            items = value if isinstance(value, tuple) else (value,)
            yield from ((name, item) for item in items if isinstance(item, int | float))
