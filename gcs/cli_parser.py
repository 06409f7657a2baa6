"""How every command's help looks: wrapped text, examples as they are typed, misuse in one line."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence
from typing import Final, NoReturn, TypeAlias

from gcs.errors import EXIT_USAGE

_EXAMPLES: Final = "examples:\n"


class _Formatter(argparse.HelpFormatter):
    """Examples keep their lines; all else is wrapped."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(_EXAMPLES) else super()._fill_text(text, width, indent)

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        return "".join(f"  {choice.dest:18s}{choice.help}\n" for choice in action._choices_actions)


class Parser(argparse.ArgumentParser):
    """Misuse is one line, not a page."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_USAGE, f"{self.prog}: {message} (see {self.prog} --help)\n")


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def add_command(
    commands: Commands, name: str, text: str, *, handler: str = "", more: str = "", examples: Sequence[str] = ()
) -> Parser:
    """A command or action: `text` is its line in the list above it; `more` is said in its own help as well.

    handler: MODULE:FUNCTION, imported only when the command runs. examples: lines as they are typed.
    """
    shown = textwrap.indent("\n".join(examples), "  ")
    p = commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}{'' if text.endswith('?') else '.'} {more}".strip(),
        epilog=f"{_EXAMPLES}{shown}" if examples else None,
        formatter_class=_Formatter,
        parents=[debug_option()],
    )
    if handler:
        p.set_defaults(handler=handler)
    return p


def add_actions(parser: Parser, metavar: str = "ACTION", *, required: bool = True) -> Commands:
    """What a command is followed by."""
    return parser.add_subparsers(metavar=metavar, required=required, parser_class=Parser, title="actions")


def debug_option() -> Parser:
    """--debug, which may stand before or after a command."""
    parser = Parser(add_help=False)
    parser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show tracebacks")
    return parser
