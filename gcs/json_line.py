"""Results for programs, on standard output."""

from __future__ import annotations

import re
from typing import Final

import msgspec

# JSON leaves these as they are, a terminal may obey them.
_CONTROLS: Final = re.compile("[\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def json_line(value: object) -> str:
    """One line, its end included; what would steer a terminal is escaped."""
    text = msgspec.json.encode(value).decode()
    return _CONTROLS.sub(lambda found: f"\\u{ord(found[0]):04x}", text) + "\n"
