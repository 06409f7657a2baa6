"""What an auditor relies on: the gate is short, and nothing but the standard library stands behind it."""

import subprocess
import sys
from pathlib import Path

from control import gate as gate_module


def test_gate_is_small_and_needs_the_standard_library_only():
    source = Path(gate_module.__file__)
    assert len(source.read_text().splitlines()) <= 150
    code = "import sys, control.gate; print(sorted(m for m in sys.modules if m in ('numpy', 'filterpy', 'scipy')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
