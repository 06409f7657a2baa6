"""Writing a result: at once or not at all, and nowhere but under its own name."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO


@contextlib.contextmanager
def result_file(path: Path) -> Iterator[IO[bytes]]:
    """Takes the place of what is there once the block is done. OSError.

    A link there is replaced and not followed: in a folder from elsewhere it may lead anywhere.
    """
    if path.is_dir() and not path.is_symlink():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    draft = path.with_name(f"{path.name}.new")
    draft.unlink(missing_ok=True)
    try:
        with draft.open("xb") as file:
            yield file
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise
