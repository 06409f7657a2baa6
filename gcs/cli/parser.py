"""How every command's help looks: wrapped text, examples as they are typed, misuse in one line."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, Final, NoReturn, TypeAlias

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

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse does, but what is not known is told by the command it was given to, with what may be meant."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            command = getattr(found, "command", self)
            word = unknown[0].partition("=")[0]
            command.error(f"unknown argument {word}{did_you_mean(word, command._option_string_actions)}")
        return found

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if isinstance(action, argparse._SubParsersAction) and value not in action.choices:
            known = ", ".join(action.choices)
            hint = did_you_mean(str(value), action.choices) or f" (there are: {known})"
            raise argparse.ArgumentError(None, f"no such {str(action.metavar).lower()}: {value}{hint}")
        super()._check_value(action, value)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint in brackets, empty where nothing is like it."""
    import difflib  # only for those who mistype

    close = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""


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
    p.set_defaults(command=p, **({"handler": handler} if handler else {}))
    return p


def add_actions(parser: Parser, metavar: str = "ACTION", *, required: bool = True) -> Commands:
    """What a command is followed by."""
    return parser.add_subparsers(metavar=metavar, required=required, parser_class=Parser, title="actions")


def debug_option() -> Parser:
    """--debug, which may stand before or after a command."""
    parser = Parser(add_help=False)
    parser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show tracebacks")
    return parser
