"""Packs in memory and big sets on the disc as one Imagery."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from tracker.train.datasets.columns import Joined, PictureFiles, Ragged, ThingColumns
from tracker.train.datasets.index import Index
from tracker.train.pack import Imagery, Thing


class JoinedImagery(Imagery):
    """An Imagery whose first pictures are the packs', the others read when they are asked for."""

    def __init__(self, packs: Imagery, sets: Sequence[tuple[str, Index, int]]) -> None:
        """sets: part's name, index, and reach of its tracks in places, for each."""
        indices = [index for _, index, _ in sets]
        pictures = list(accumulate((len(i.names) for i in indices), initial=len(packs)))[:-1]
        things = list(accumulate((len(i.image) for i in indices), initial=len(packs.things)))[:-1]
        tracks = [Ragged(i.track, i.track_starts, n) for i, n in zip(indices, things, strict=True)]
        clips = [Ragged(i.clip, i.clip_starts, n) for i, n in zip(indices, pictures, strict=True)]
        super().__init__(
            pyramids=Joined([packs.pyramids, *(PictureFiles(i.folders.tolist(), i.folder, i.names) for i in indices)]),
            masks=packs.masks,
            parts=Joined([packs.parts, *([name] * len(index.names) for name, index, _ in sets)]),
            frames=Joined([packs.frames, *(i.frame for i in indices)]),
            things=Joined([packs.things, *map(ThingColumns, indices, pictures)]),
            tracks=Joined([packs.tracks, *tracks]),
            clips=Joined([packs.clips, *clips]),
        )
        self._packs = packs
        self._names = [name for name, _, _ in sets]
        self._reaches = [reach for _, _, reach in sets]

    @property
    def in_memory(self) -> bool:
        return not any(len(piece) for piece in self.pyramids.pieces if isinstance(piece, PictureFiles))

    def reach(self, track: int) -> int:
        piece, at = self.tracks.place(track)
        return self._reaches[piece - 1] if piece else self._packs.reach(at)

    def outlined(self) -> list[int]:
        return self.things.each(_outlined)

    def label(self, thing: int) -> str:
        piece, at = self.things.place(thing)
        return self.things.pieces[piece].label(at) if piece else self._packs.label(at)

    def part_counts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As Imagery's, without a look at each of millions of things: all of a set's are of one part."""
        own, inverse, _ = self._packs.part_counts()
        names = sorted({*own.tolist(), *self._names})
        codes = [np.array([names.index(n) for n in own], np.intp)[inverse]]
        codes += [
            np.full(len(piece), names.index(name))
            for name, piece in zip(self._names, self.things.pieces[1:], strict=True)
        ]
        present, inverse, counts = np.unique(np.concatenate(codes), return_inverse=True, return_counts=True)
        return np.array(names)[present], inverse, counts


def _outlined(things: Sequence[Thing]) -> Sequence[int]:
    if isinstance(things, ThingColumns):
        return things.outlined()
    return [i for i, t in enumerate(things) if t.outline or t.mask_of >= 0]
