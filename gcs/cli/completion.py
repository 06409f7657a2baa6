"""`gcs completion`: a script for the shell, made from the arguments themselves."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import shtab

from gcs.cli.entry import build_parser
from gcs.profiles import profile_names
from sitl_mocks import scenario, sequences

_FILES: Final = ("FILE", "NAME|FILE", "VIDEO", "CONFIG", "FILE|KEY", "DATASET", "URL", "TLOG")
_FOLDERS: Final = ("DIR", "FLIGHT")


def main(args: argparse.Namespace) -> int:
    """Print it."""
    print(script(args.shell))
    return 0


def script(shell: str) -> str:
    """For bash, zsh or tcsh."""
    parser = build_parser()
    names: Mapping[str, Sequence[str]] = {
        "--profile": profile_names(),
        "--scenario": scenario.names(),
        "--sample": list(sequences.names()),
    }
    for action in _actions(parser):
        known = next((names[option] for option in action.option_strings if option in names), None)
        if known is not None:
            action.choices = known
        elif action.metavar in _FILES:
            _complete(action, shtab.FILE)
        elif action.metavar in _FOLDERS:
            _complete(action, shtab.DIRECTORY)
    return str(shtab.complete(parser, shell=shell))


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                command = action.choices[choice.dest]
                command.description = choice.help  # the short one is shown beside its name
                yield from _actions(command)
        elif action.nargs != 0:
            yield action


def _complete(action: Any, kind: Any) -> None:
    """Where shtab looks for it."""
    action.complete = kind
