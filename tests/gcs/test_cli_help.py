"""What `--help` says: everything is listed, short, and each example can be typed as it stands."""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Iterator

import pytest

from gcs.cli import completion as cli_completion
from gcs.cli import entry as cli
from gcs.errors import EXIT_USAGE

WANTED = ("run", "dry-run", "demo", "sim", "replay", "bench", "doctor", "audit", "report", "weights", "config")


def parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """This one and all below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


def commands() -> list[argparse.ArgumentParser]:
    return [parser for parser in parsers(cli.build_parser()) if parser.prog != "gcs"]


def examples(parser: argparse.ArgumentParser) -> list[list[str]]:
    lines = (parser.epilog or "").splitlines()[1:]
    return [shlex.split(line.partition(" > ")[0], comments=True)[1:] for line in lines]


def test_every_command_is_in_one_group_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    page = cli.build_parser().format_help()
    assert [line for line in page.splitlines() if len(line) > 80] == []
    listed = [line.split()[0] for line in page.splitlines() if line.startswith("  ") and not line.startswith("  -")]
    assert set(WANTED) <= set(listed)
    assert len(listed) == len(set(listed))
    assert "130 interrupted" in page


@pytest.mark.parametrize("parser", commands(), ids=lambda parser: parser.prog)
def test_each_help_is_narrow_and_its_examples_are_understood(
    parser: argparse.ArgumentParser, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = parser.format_help()
    assert [line for line in text.splitlines() if len(line) > 80 and not line.startswith("  gcs ")] == []
    assert examples(parser)
    for words in examples(parser):
        cli.build_parser().parse_args(words)  # misuse would exit


def test_an_example_that_is_not_understood_would_be_noticed() -> None:
    with pytest.raises(SystemExit) as caught:
        cli.build_parser().parse_args(["sim", "--no-such-thing"])
    assert caught.value.code == EXIT_USAGE


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_commands_profiles_and_scenarios(shell: str) -> None:
    script = cli_completion.script(shell)
    assert "doctor" in script
    assert "px4-sitl" in script
    assert "stop-and-go" in script


def test_bash_completes_what_the_script_says() -> None:
    ask = "\n".join(
        (
            cli_completion.script("bash"),
            'try() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()',
            '_shtab_gcs gcs "${@: -1}"; echo "${COMPREPLY[*]}"; }',
            "try gcs re; try gcs run --profile si; try gcs config pyproject.to",
        )
    )
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["replay report", "sim sim-gimbal", "pyproject.toml"]


def test_the_version_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out.startswith("gcs ")


@pytest.mark.parametrize("argv", [["sim", "--help"], ["doctor", "--help"], ["config", "--help"], ["--version"]])
def test_nothing_heavy_is_imported_to_say_what_a_command_does(argv: list[str]) -> None:
    program = (
        "import sys\nfrom gcs.cli.entry import main\n"
        f"try: main({argv!r})\nexcept SystemExit: pass\n"
        "heavy = ('torch', 'cv2', 'numpy', 'mavsdk', 'pymavlink', 'aiohttp', 'asyncio', 'rich', 'yaml', 'shtab')\n"
        "print('HEAVY', [m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "HEAVY []"


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["doctr"], "gcs: no such command: doctr (did you mean doctor?)"),
        (["weights", "infoo"], "gcs weights: no such action: infoo (did you mean info?)"),
        (["run", "--vidoe", "x"], "gcs run: unknown argument --vidoe (did you mean --video?) (see gcs run --help)"),
        (["keys", "new", "--passprase=x"], "gcs keys new: unknown argument --passprase (did you mean --passphrase?)"),
        (["qqq"], "there are: run, demo, sim"),
    ],
)
def test_a_slip_is_told_by_its_command(argv: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(argv)
    assert caught.value.code == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
