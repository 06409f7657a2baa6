"""Mutation run over the code that may move the vehicle: would any test notice if a line of it were wrong?

`make mutate` copies that code and its fast tests into build/mutation, lets mutmut change one operator,
number or word at a time, and fails unless every change that no test noticed stands in equivalent.txt with
the reason why it changes nothing. Survivors are named by what was changed, not by number: numbers move.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WORKSPACE = ROOT / "build" / "mutation"
EQUIVALENT = HERE / "equivalent.txt"
MUTATED = (
    "gate",
    "gate_limits",
    "fence",
    "checks",
    "engagement",
    "causes",
    "preflight",
)  # of control/, where they exist
TESTS = (
    "tests/control/test_gate*.py",
    "tests/control/test_fence*.py",
    "tests/control/engagement_story.py",
    "tests/control/test_engagement*.py",
    "tests/control/test_causes*.py",
    "tests/control/test_preflight*.py",
    "tests/control/test_config.py",
    "tests/property/test_gate*.py",
)
CONFIG = """\
[tool.mutmut]
source_paths = ["control"]
only_mutate = {mutated}
pytest_add_cli_args = ["-p", "no:cacheprovider", "-p", "no:randomly", "-m", "not slow"]
pytest_add_cli_args_test_selection = {tests}
timeout_constant = 5.0
use_git_change_detection = false

[tool.pytest.ini_options]
addopts = "-q -x --strict-markers"
markers = ["slow: more than a few seconds"]
asyncio_default_fixture_loop_scope = "function"
"""


def main() -> int:
    """Exit status 0 only where every mutant was noticed or is known to change nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="*", help="mutants to try, such as 'control.gate.*'; all of them by default")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    known = equivalents(EQUIVALENT.read_text(encoding="utf-8"))
    prepare()
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", str(args.jobs), *args.only]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "GATE_CALLS": "2000", "GATE_EXAMPLES": "15"}
    done = subprocess.run(command, cwd=WORKSPACE, env=environment, check=False)
    if done.returncode:
        print("mutmut itself failed: see above", file=sys.stderr)
        return 2
    return report(known, partial=bool(args.only))


def prepare() -> None:
    """A fresh workspace: nothing remembered, and nothing of it seen by git, ruff or mypy."""
    shutil.rmtree(WORKSPACE, ignore_errors=True)
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "control", WORKSPACE / "control", ignore=ignore)
    tests = sorted(path for pattern in TESTS for path in ROOT.glob(pattern))
    for folder in ("tests/control", "tests/property"):
        shutil.copytree(ROOT / folder, WORKSPACE / folder, ignore=ignore)
    shutil.copy(ROOT / "tests" / "__init__.py", WORKSPACE / "tests")
    mutated = [f"control/{name}.py" for name in MUTATED if (ROOT / "control" / f"{name}.py").exists()]
    selection = [str(path.relative_to(ROOT)) for path in tests]
    (WORKSPACE / "pyproject.toml").write_text(CONFIG.format(mutated=mutated, tests=selection), encoding="utf-8")


def equivalents(text: str) -> dict[str, str]:
    """Mutant -> reason; a mutant stands on a line of its own, its reason on indented lines below it."""
    known: dict[str, str] = {}
    name = ""
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        if not line.startswith(" "):
            name = line.strip()
            known[name] = ""
        elif name:
            known[name] = f"{known[name]} {line.strip()}".strip()
        else:
            raise SystemExit(f"{EQUIVALENT}:{number}: a reason without a mutant above it")
    unreasoned = [name for name, reason in known.items() if not reason]
    if unreasoned:
        raise SystemExit(f"{EQUIVALENT}: no reason given for {unreasoned[0]}")
    return known


def report(known: dict[str, str], *, partial: bool) -> int:
    """Print the table and the survivors; 0 where each is known to be equivalent."""
    os.chdir(WORKSPACE)
    # Reads its configuration from the working directory, at import.
    from mutmut.mutation.data import SourceFileMutationData
    from mutmut.stats import status_by_exit_code

    unknown: list[str] = []
    seen: set[str] = set()
    for path in sorted(Path("mutants/control").glob("*.meta")):
        data = SourceFileMutationData(path=Path("control") / path.stem)
        data.load()
        counts: dict[str, int] = {}
        for mutant, exit_code in data.exit_code_by_key.items():
            status = status_by_exit_code[exit_code]
            if status in ("survived", "no tests", "suspicious"):
                name = described(mutant)
                seen.add(name)
                status = "equivalent" if name in known else status
                if name not in known:
                    unknown.append(f"{name}\n    ({mutant})")
            counts[status] = counts.get(status, 0) + 1
        if counts:
            print(f"control/{path.stem}: " + ", ".join(f"{n} {status}" for status, n in sorted(counts.items())))
    for name in unknown:
        print(f"SURVIVED {name}")
    stale = [] if partial else sorted(set(known) - seen)
    for name in stale:
        print(f"not found any more, take it out of {EQUIVALENT.name}: {name}")
    return 1 if unknown or stale else 0


def described(mutant: str) -> str:
    """`control.gate._shape: old code => new code`."""
    from mutmut.mutation.diff_apply import get_diff_for_mutant

    lines = get_diff_for_mutant(mutant).splitlines()
    sides = [
        " ".join(line[1:].strip() for line in lines if line.startswith(sign) and not line.startswith(sign * 3))
        for sign in "-+"
    ]
    where = mutant.rsplit("__mutmut_", 1)[0].replace("ǁ", ".").replace(".x.", ".").replace(".x_", ".")
    return f"{where}: {sides[0]} => {sides[1]}"


if __name__ == "__main__":
    sys.exit(main())
