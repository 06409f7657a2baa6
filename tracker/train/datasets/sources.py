"""The pictures of a training run from everything its configuration names: packs, and big sets as published."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from tracker.train.datasets import coco, got10k, vid, vimeo
from tracker.train.datasets.index import DatasetError, Index, cache_folder, cached, signature
from tracker.train.datasets.joined import JoinedImagery
from tracker.train.pack import Imagery, load

READERS: Mapping[str, ModuleType] = {"coco": coco, "vid": vid, "got10k": got10k, "vimeo": vimeo}
# Where each comes from and on what terms, for the manifest of weights trained on it.
CREDITS: Mapping[str, tuple[str, str]] = {
    "coco": ("https://cocodataset.org", "annotations CC BY 4.0, pictures by Flickr's terms"),
    "vid": ("https://image-net.org/challenges/LSVRC/2015", "research and education, not commercial"),
    "got10k": ("http://got-10k.aitestunion.com", "CC BY-NC-SA 4.0, not commercial"),
    "vimeo": ("http://toflow.csail.mit.edu", "not commercial"),
}

RawSource = str | Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Source:
    """A big data set: its kind, where it lies, which subset to learn from and which to hold out, how much of it.

    subset, val_subset: None = the set's own (train2017 and val2017 for COCO). limit: so many pictures of stills or
    clips of videos, evenly taken; None = all.
    """

    dataset: str
    root: Path
    subset: str | None = None
    val_subset: str | None = None
    limit: int | None = None

    @classmethod
    def of(cls, values: Mapping[str, Any], data: Path) -> Source:
        """From plain values (root may be relative to the data folder); raises DatasetError naming the key."""
        if unknown := sorted(set(values) - set(cls.__dataclass_fields__)):
            raise DatasetError(f"packs: unknown key {unknown[0]!r}; known: {', '.join(cls.__dataclass_fields__)}")
        if values.get("dataset") not in READERS:
            raise DatasetError(f"packs: dataset = {values.get('dataset')!r}: known are {', '.join(READERS)}")
        if not isinstance(values.get("root"), str | Path):
            raise DatasetError(f"packs: {values['dataset']} has no root, the folder that it lies in")
        limit = values.get("limit")
        if limit is not None and (not isinstance(limit, int) or isinstance(limit, bool) or limit < 1):
            raise DatasetError(f"packs: limit = {limit!r} is not a number of pictures or clips")
        for key in ("subset", "val_subset"):
            if values.get(key) is not None and not isinstance(values[key], str):
                raise DatasetError(f"packs: {key} = {values[key]!r} is not a name")
        return cls(**{**values, "root": data / Path(values["root"]).expanduser()})

    def subset_for(self, split: str) -> str | None:
        """The subset to read for a split; None where nothing is held out: no val_subset named, none on the disc."""
        reader = READERS[self.dataset]
        if split == "train":
            return self.subset or reader.TRAIN
        if self.val_subset:
            return self.val_subset
        try:
            reader.sources(self.root, reader.VAL)
        except DatasetError:
            return None
        return reader.VAL if self.subset_for("train") != reader.VAL else None


def load_sources(sources: Iterable[RawSource], data: Path, split: str = "train", cache: Path | None = None) -> Imagery:
    """Everything that the sources hold for a split ('train' or 'val'): packs in memory, big sets on the disc.

    sources: names of packs in the data folder, or mappings as of Source. cache: folder for the big sets' indices
    (the user's cache folder by default). Raises DatasetError for what is missing or not as published, and where
    there is nothing to train on; nothing may be held out.
    """
    sources = list(sources)
    packs = [data / s for s in sources if isinstance(s, str)]
    for pack in packs:
        if not pack.exists():
            raise DatasetError(f"{pack}: no such pack of training pictures")
    sets = [Source.of(s, data) for s in sources if not isinstance(s, str)]
    indices = []
    for source in sets:  # first: what is missing shows before minutes of decoding
        subset = source.subset_for(split)
        if subset is not None:
            index = index_of(source, subset, cache or cache_folder())
            indices.append((source.dataset, index, READERS[source.dataset].REACH))
    found = load(packs, split)
    found = JoinedImagery(found, indices) if indices else found
    if not len(found) and split == "train":
        raise DatasetError("packs: no picture to train on in them")
    return found


def index_of(source: Source, subset: str, cache: Path) -> Index:
    """The index of a subset: from the cache where its files are still the same."""
    reader = READERS[source.dataset]
    files = reader.sources(source.root, subset)
    name = signature(source.dataset, subset, source.limit, files=files)
    return cached(cache, f"{source.dataset}-{name}", lambda: reader.read(source.root, subset, source.limit))


def credits_of_sets(sources: Iterable[RawSource]) -> list[dict[str, str]]:
    """Part, source and licence of each big set among the sources, as the manifest of trained weights names them."""
    names = dict.fromkeys(str(s["dataset"]) for s in sources if not isinstance(s, str))
    return [{"part": name, "repository": CREDITS[name][0], "licence": CREDITS[name][1]} for name in names]
