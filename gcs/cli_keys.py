"""`gcs keys`: make a signing key, show which one it is, put it on a vehicle."""

from __future__ import annotations

import argparse
import asyncio
import getpass
import sys
from pathlib import Path
from typing import Any, Final

from gcs.keys import SigningKey, default_path, read_key, write_key

_HOW_TO: Final = """\
Put it on the vehicle, PX4 or ArduPilot, over a cable, never by radio (it travels in the clear):
  gcs keys send --vehicle serial:///dev/ttyACM0:57600 {path}
A key made with --passphrase can also be set with MAVProxy (signing setup PASSPHRASE) or QGroundControl.
Then fly with it:
  gcs run --signing-key {path}
"""


def add_parser(commands: Any, common: argparse.ArgumentParser) -> None:
    """The command and its arguments."""
    text = "keys for MAVLink signing, so that only you fly the vehicle"
    actions = commands.add_parser("keys", help=text, description=text, parents=[common]).add_subparsers(
        metavar="ACTION", required=True, parser_class=type(common)
    )
    p = actions.add_parser("new", help="make a key; never overwrites one", parents=[common])
    p.set_defaults(handler="gcs.cli_keys:new")
    text = "read a passphrase instead; QGroundControl and MAVProxy make the same key of it"
    p.add_argument("--passphrase", action="store_true", help=text)
    _add_file(p)
    p = actions.add_parser("show-fingerprint", help="which key a file holds, without showing it", parents=[common])
    p.set_defaults(handler="gcs.cli_keys:show_fingerprint")
    _add_file(p)
    text = "put the key on a vehicle by SETUP_SIGNING, in the clear: over a cable"
    p = actions.add_parser("send", help=text, description=text, parents=[common])
    p.set_defaults(handler="gcs.cli_keys:send")
    p.add_argument("--vehicle", metavar="URL", required=True, help="as for `gcs run`")
    p.add_argument("--timeout", type=float, default=15.0, metavar="S", help="how long to wait for it (default: 15)")
    _add_file(p)


def _add_file(p: argparse.ArgumentParser) -> None:
    p.add_argument("path", nargs="?", metavar="FILE", help="default: ~/.config/climrt-gcs/signing.key")


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
