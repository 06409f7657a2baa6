"""`gcs keys`: make a signing key, show which one it is, put it on a vehicle."""

from __future__ import annotations

import argparse
import asyncio
import getpass
import sys
from pathlib import Path
from typing import Final

from gcs.keys import SigningKey, default_path, read_key, write_key

_HOW_TO: Final = """\
Put it on the vehicle, PX4 or ArduPilot, over a cable, never by radio (it travels in the clear):
  gcs keys send --vehicle serial:///dev/ttyACM0:57600 {path}
A key made with --passphrase can also be set with MAVProxy (signing setup PASSPHRASE) or QGroundControl.
Then fly with it:
  gcs run --signing-key {path}
"""


def new(args: argparse.Namespace) -> int:
    """Write a new key file and say how to use it."""
    path = _path(args)
    key = SigningKey.from_passphrase(_ask()) if args.passphrase else SigningKey.random()
    write_key(path, key)
    print(f"{path}: new signing key, fingerprint {key.fingerprint}")
    print(_HOW_TO.format(path=path), end="")
    return 0


def show_fingerprint(args: argparse.Namespace) -> int:
    """The fingerprint of a key file."""
    path = _path(args)
    print(f"{path}: {read_key(path).fingerprint}")
    return 0


def send(args: argparse.Namespace) -> int:
    """Give the vehicle the key and wait until it signs with it."""
    from gcs.key_transfer import send_key  # MAVLink is not needed for the help text

    path = _path(args)
    key = read_key(path)
    vehicle = asyncio.run(send_key(args.vehicle, key, args.timeout, _say))
    print(f"{vehicle} now signs with the key of {path}, fingerprint {key.fingerprint}")
    return 0


def _say(text: str) -> None:
    print(f"gcs: {text}", file=sys.stderr, flush=True)


def _path(args: argparse.Namespace) -> Path:
    return default_path() if args.path is None else Path(args.path)


def _ask() -> str:
    """The passphrase, from the terminal without echo or from a pipe; never from the command line."""
    if sys.stdin.isatty():
        return getpass.getpass("passphrase: ")
    return sys.stdin.readline().rstrip("\r\n")
