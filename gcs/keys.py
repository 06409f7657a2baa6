"""MAVLink signing keys: 32 bytes in a file that only its owner can read. Never from anywhere else, never logged.

The file holds 64 hexadecimal characters. A passphrase becomes a key by SHA-256, as in QGroundControl and MAVProxy.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import stat
from dataclasses import dataclass, field
from pathlib import Path

from gcs.errors import GcsError

KEY_BYTES = 32
PASSPHRASE_CHARS = 12  # fewer are guessed from one recorded frame in no time
_LOOKS_LIKE_A_KEY = re.compile(r"[0-9a-fA-F]{64}")


class KeyFileError(GcsError):
    """A signing key that cannot be used; never says what the key is."""


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The secret both ends share."""

    secret: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if len(self.secret) != KEY_BYTES or not any(self.secret):  # all zeros switch signing off on a vehicle
            raise KeyFileError("a signing key is 32 bytes, not all of them zero")

    @property
    def fingerprint(self) -> str:
        """Tells keys apart without giving them away."""
        digest = hashlib.sha256(b"MAVLink signing key fingerprint" + self.secret).hexdigest()
        return ":".join(digest[i : i + 4] for i in range(0, 16, 4))

    @classmethod
    def random(cls) -> SigningKey:
        """From the system's source of randomness."""
        return cls(secrets.token_bytes(KEY_BYTES))

    @classmethod
    def from_passphrase(cls, passphrase: str) -> SigningKey:
        """As QGroundControl and MAVProxy do it: SHA-256 of the text. KeyFileError if it is too short."""
        if len(passphrase) < PASSPHRASE_CHARS:
            raise KeyFileError(f"the passphrase needs at least {PASSPHRASE_CHARS} characters")
        return cls(hashlib.sha256(passphrase.encode()).digest())


def default_path() -> Path:
    """$XDG_CONFIG_HOME/climrt-gcs/signing.key, by default under ~/.config."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "climrt-gcs" / "signing.key"


def read_key(path: Path) -> SigningKey:
    """The key of a file; KeyFileError if it is missing, open to others, or holds no key."""
    _refuse_key_text(path)
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise KeyFileError(f"signing key {path}: not a file")
            if os.name == "posix" and status.st_mode & 0o077:
                raise KeyFileError(f"signing key {path}: others can read or change it; run: chmod 600 {path}")
            text = file.read(1024).strip()
    except OSError as error:
        raise KeyFileError(f"signing key {path}: {(error.strerror or 'cannot be read').lower()}") from None
    if not _LOOKS_LIKE_A_KEY.fullmatch(text.decode("ascii", "replace")):
        raise KeyFileError(f"signing key {path}: must hold 64 hexadecimal characters and nothing else")
    return SigningKey(bytes.fromhex(text.decode("ascii")))


def write_key(path: Path, key: SigningKey) -> None:
    """A new file that only its owner can read; KeyFileError if there is one already."""
    _refuse_key_text(path)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(key.secret.hex() + "\n")
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError:
        raise KeyFileError(f"signing key {path}: exists already and is never overwritten") from None
    except OSError as error:
        raise KeyFileError(f"signing key {path}: {(error.strerror or 'cannot be written').lower()}") from None


def _refuse_key_text(path: Path) -> None:
    """Somebody gave the key itself where its file belongs: do not repeat it in an error line."""
    if _LOOKS_LIKE_A_KEY.fullmatch(path.name):
        raise KeyFileError("signing key: give the path of the key's file, not the key itself")
