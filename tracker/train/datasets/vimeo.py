"""Vimeo-90K: clips of three (triplet) or seven (septuplet) adjacent frames, 448 x 256 px, without any boxes.

Layout (http://toflow.csail.mit.edu, readme.txt of the archives): tri_trainlist.txt, tri_testlist.txt and
sequences/00001/0001/im1.png … im3.png; the septuplets have sep_trainlist.txt and im1.png … im7.png. What lies in
the middle of three adjacent frames is ClimNet's lesson; nothing here is tracked. Licence: not commercial.
"""

from __future__ import annotations

import re
from pathlib import Path

from tqdm import tqdm

from tracker.train.datasets.files import need_folder, read_lines, spread
from tracker.train.datasets.index import DatasetError, Index, IndexWriter

TRAIN, VAL = "train", "test"
REACH = 1
FRAMES = {"tri": 3, "sep": 7}


def list_of(root: Path, subset: str) -> tuple[Path, int]:
    """The subset's list of sequences, and how many frames each has."""
    need_folder(need_folder(root, "root of Vimeo-90K") / "sequences", "Vimeo-90K's pictures")
    for kind, count in FRAMES.items():
        path = root / f"{kind}_{subset}list.txt"
        if path.is_file():
            return path, count
    raise DatasetError(f"{root}: neither tri_{subset}list.txt nor sep_{subset}list.txt in it (Vimeo-90K's sequences)")


def sources(root: Path, subset: str) -> list[Path]:
    """The file that the index is made from."""
    return [list_of(root, subset)[0]]


def read(root: Path, subset: str, limit: int | None) -> Index:
    """Index `limit` sequences; raises DatasetError naming the list and the line."""
    path, count = list_of(root, subset)
    names = read_lines(path, "Vimeo-90K's sequences")
    for name in names:
        if not re.fullmatch(r"\d+/\d+", name):
            raise DatasetError(f"{path}: {name!r} is no sequence like 00001/0001")
    index = IndexWriter()
    for name in tqdm(spread(names, limit), desc=f"Vimeo-90K {subset}", delay=2, leave=False, dynamic_ncols=True):
        folder = root / "sequences" / name
        index.clip([index.picture(folder, f"im{k}.png", k) for k in range(1, count + 1)])
    return index.finish()
