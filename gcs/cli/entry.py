"""`gcs`: the command line. Arguments only; each command imports what it needs when it runs.

So `gcs --help` answers at once: neither PyTorch, OpenCV nor MAVSDK is imported for it.
"""

from __future__ import annotations

import argparse
import importlib
import logging
import os
import sys
from collections.abc import Callable
from typing import Any, Final

from gcs.cli import args_fly, args_footage, args_measure, args_setup
from gcs.cli.parser import Commands, Parser, debug_option
from gcs.errors import EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USAGE, GcsError, one_line

_ABOUT: Final = """\
Tracks one object in a drone's video with ClimRT and follows it over MAVLink.
New here? `gcs demo` shows a flight, `gcs sim` and `gcs run --profile sim` let
you fly one, `gcs doctor` says what to fix."""
_PARTS: Final = (
    ("fly", args_fly),
    ("video and records", args_footage),
    ("set up", args_setup),
    ("measure", args_measure),
)
_EPILOG: Final = """\
options:
  -h, --help  show this
  --version   show the version
  --debug     show tracebacks

exit status: 0 done, 1 a check failed or a fault of gcs itself, 2 bad input,
3 training not finished yet (go on with --resume), 130 interrupted.
Results are on stdout (with --json as JSON lines), all else on stderr."""
# The libraries raise ValueErrors of their own for bad input; a plain ValueError is a fault of ours.
LIBRARIES = ("tracker", "control", "sitl_mocks", "gcs")


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 our fault, 2 bad input, 130 interrupted."""
    args = build_parser().parse_args(argv)
    debug = bool(getattr(args, "debug", False))
    logging.basicConfig(level=logging.INFO if debug else logging.WARNING, format="gcs: %(message)s")
    # A picture bomb is refused before memory is taken for it; OpenCV reads this when it is first imported.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(4096 * 2160))
    try:
        handler: Callable[[argparse.Namespace], int] = _load(args.handler)
        return handler(args)
    except KeyboardInterrupt:
        print("gcs: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # `gcs ... | head`: nobody reads on; keep the interpreter from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAULT
    except Exception as error:
        if debug:
            raise
        text, status = describe(error)
        print(f"gcs: {text}", file=sys.stderr)
        return status


def describe(error: Exception) -> tuple[str, int]:
    """One line for the user, and the exit status."""
    if isinstance(error, GcsError):
        return one_line(error), error.exit_code
    ours = type(error).__module__.split(".")[0] in LIBRARIES
    if isinstance(error, ValueError) and ours:
        return one_line(error), EXIT_USAGE
    if isinstance(error, OSError) and error.filename is not None:
        return one_line(f"{error.filename}: {error.strerror or error}"), EXIT_USAGE
    kind = type(error).__name__
    return one_line(f"internal fault, {kind}: {error}; --debug shows where"), EXIT_FAULT


class _Top(Parser):
    """`gcs --help`: the commands by what they are for, instead of one long list."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.groups: list[tuple[str, Commands, list[str]]] = []

    def format_help(self) -> str:
        """The page."""
        lines = ["usage: gcs COMMAND ...   (gcs COMMAND --help says more, with examples)", "", _ABOUT]
        for title, commands, names in self.groups:
            about = {choice.dest: choice.help for choice in commands._choices_actions}
            lines += ["", f"{title}:", *(f"  {name:11s} {about[name]}" for name in names)]
        return "\n".join([*lines, "", _EPILOG, ""])


def build_parser() -> Parser:
    """All commands and their arguments."""
    parser = _Top(prog="gcs", description=_ABOUT, parents=[debug_option()])
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and leave")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for title, part in _PARTS:
        known = set(commands.choices)
        part.add(commands)
        parser.groups.append((title, commands, [name for name in commands.choices if name not in known]))
    return parser


class _Version(argparse.Action):
    """Packages are looked through only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_args: object) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            text = version("climrt-gcs")
        except PackageNotFoundError:
            text = "(not installed)"
        print(f"gcs {text}")
        parser.exit()


def _load(name: str) -> Callable[[argparse.Namespace], int]:
    module, _, function = name.partition(":")
    handler: Callable[[argparse.Namespace], int] = getattr(importlib.import_module(module), function)
    return handler
