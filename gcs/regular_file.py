"""Opening what should be a file: a device or a pipe under its name would be read for ever, or waited for."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import IO


def open_regular(path: Path) -> IO[bytes]:
    """To be read. OSError, with its filename, for what is no file of a disk, as for what cannot be opened."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        return open(number, "rb")
    os.close(number)
    kind = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
    raise OSError(kind, os.strerror(kind) if stat.S_ISDIR(mode) else "Not a file", str(path))
