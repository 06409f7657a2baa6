"""Everything this program may tell its user went wrong: each message is one line that says what and where."""

from __future__ import annotations

EXIT_FAULT = 1  # a fault of this program
EXIT_USAGE = 2  # bad input
EXIT_INTERRUPTED = 130


class GcsError(Exception):
    """The root: the command line prints `gcs: <message>` and exits with `exit_code`, without a traceback."""

    exit_code = EXIT_USAGE


class ConfigError(GcsError):
    """A configuration file that cannot be used; names the file, the line and the key."""


class VideoError(GcsError):
    """A video file, image folder or stream that cannot be opened or read."""


class SelectionError(GcsError):
    """A box that cannot be tracked: outside the frame, too small, or no way to draw one."""


class WireError(GcsError):
    """The link to the vehicle: a bad address, a port in use, a device that is not there."""


class PageError(GcsError):
    """The operator's page cannot be served: its address is in use, or not one of this machine."""


class VehicleError(GcsError):
    """The vehicle did not answer in time, or refused what it was asked (with its own reason)."""


def one_line(text: object) -> str:
    """For the terminal: the first 500 characters, with line breaks and control characters made harmless."""
    return printable(str(text)[:500]).strip()


def printable(text: str) -> str:
    """What comes from elsewhere shall not steer the terminal: a blank for each line break and control character."""
    return "".join(c if c.isprintable() else " " for c in text)
