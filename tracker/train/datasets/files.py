"""What the readers of data sets share: files with one clear line for what is wrong, shares, and progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from tracker.train.datasets.index import DatasetError

T = TypeVar("T")
R = TypeVar("R")
READERS = 8  # threads: small files on a disc or a network wait more than they compute


def need_folder(path: Path, what: str) -> Path:
    """The folder, or DatasetError where there is none."""
    if not path.is_dir():
        raise DatasetError(f"{path}: no such folder ({what})")
    return path


def need_file(path: Path, what: str) -> Path:
    """The file, or DatasetError where there is none."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such file ({what})")
    return path


def read_lines(path: Path, what: str) -> list[str]:
    """The lines that are not blank."""
    try:
        text = need_file(path, what).read_text()
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: not text ({what})") from error
    return [line.strip() for line in text.splitlines() if line.strip()]


def spread(items: Sequence[T], limit: int | None) -> list[T]:
    """At most `limit` of the items, evenly from first to last: lists are often sorted by class."""
    if limit is None or limit >= len(items):
        return list(items)
    return [items[i * len(items) // limit] for i in range(limit)]


def in_order(work: Callable[[T], R], items: Sequence[T], title: str) -> Iterator[R]:
    """What `work` makes of each item, in the items' order, made by a few threads under a progress bar."""
    with (
        ThreadPoolExecutor(READERS) as pool,
        tqdm(total=len(items), desc=title, unit="", delay=2, leave=False, dynamic_ncols=True) as bar,
    ):
        for k in range(0, len(items), 64):  # not all at once: what is done early would wait in memory
            for result in pool.map(work, items[k : k + 64]):
                bar.update()
                yield result
