"""`gcs config`: the example, a check, the profiles, and where each value comes from."""

from __future__ import annotations

import argparse
import json
import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gcs.cli.args_operator import with_operator_arguments
from gcs.cli.args_vehicle import with_arguments
from gcs.cli.parser import did_you_mean
from gcs.config import Config, load_with_origins
from gcs.config_example import render
from gcs.config_explain import DEFAULT, Explained, chosen, explain, in_words, is_of, keys, shown
from gcs.errors import ConfigError
from gcs.profiles import profile_names, profile_path, profile_text

_INDENT: Final = " " * 6
_WIDEST: Final = 120


def main(args: argparse.Namespace) -> int:
    """Print, check or explain."""
    if args.profiles:
        return _profiles(args.words)
    file, wanted = _sort(args.words, keys())
    written = load_with_origins(file, args.profile)
    config = with_all_arguments(written.value, args)
    if args.explain or args.changed:
        rows = chosen(explain(config, written.value, written.origins), wanted)
        _show([row for row in rows if row.is_changed or not args.changed], as_json=args.json)
    elif wanted:
        raise ConfigError(f"{wanted[0]}: a key is shown by `gcs config --explain {wanted[0]}`")
    else:
        print(f"{file}: good" if file is not None else render(config), end="\n" if file is not None else "")
    return 0


def with_all_arguments(config: Config, args: argparse.Namespace) -> Config:
    """As `gcs run` would have it."""
    if args.video is not None:
        config = replace(config, video=replace(config.video, url=args.video))
    return with_operator_arguments(replace(config, vehicle=with_arguments(config.vehicle, args)), args)


def _profiles(names: Sequence[str]) -> int:
    if names:
        print("\n".join(profile_path(name).read_text(encoding="utf-8") for name in names), end="")
        return 0
    for name in profile_names():
        print(f"{name:16s} {profile_text(name)}")
    print("`gcs config --profiles NAME` shows what is in one, `--profile NAME` uses it.")
    return 0


def _sort(words: Sequence[str], known: Sequence[str]) -> tuple[str | None, list[str]]:
    """The file and the keys among them; ConfigError for what is neither."""
    files = [word for word in words if _is_file(word, known)]
    wanted = [word for word in words if word not in files]
    if len(files) > 1:
        raise ConfigError(f"{files[1]}: only one file at a time, {files[0]} was given before it")
    for word in wanted:
        if not any(is_of(key, word) for key in known):
            parts = {key.rsplit(".", depth)[0] for key in known for depth in range(3)} | set(known)
            hint = did_you_mean(word, sorted(parts))
            raise ConfigError(f"{word}: neither a file nor a key of the configuration{hint}")
    return (files[0] if files else None), wanted


def _is_file(word: str, known: Sequence[str]) -> bool:
    if any(is_of(key, word) for key in known):
        return False
    path = Path(word)
    return path.exists() or len(path.parts) > 1 or path.suffix in (".yaml", ".yml")


def _show(rows: Sequence[Explained], *, as_json: bool) -> None:
    if as_json:
        for row in rows:
            print(json.dumps(row.as_json()))
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    for row in rows:
        first = f"{'*' if row.is_changed else ' '} {row.key} = {in_words(row)}"
        console.print(Text(first, style="bold green" if row.is_changed else ""))
        console.print(Text(_INDENT + " | ".join(_facts(row)), style="dim"))
        if row.meaning:
            indented = textwrap.fill(row.meaning, width, initial_indent=_INDENT, subsequent_indent=_INDENT)
            console.print(Text(indented))
    count = sum(row.is_changed for row in rows)
    console.print(Text(f"{len(rows)} values, {count} changed (*)", style="dim"))


def _facts(row: Explained) -> list[str]:
    facts = [row.source]
    if row.is_changed or row.source != DEFAULT:
        facts.append(f"default {shown(row.default)}")
    if row.low is not None and row.high is not None:
        facts.append(f"from {row.low:g} to {row.high:g}")
    if row.choices:
        facts.append(f"one of {', '.join(row.choices)}")
    return facts
