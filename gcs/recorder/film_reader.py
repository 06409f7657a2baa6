"""The film of a flight, read back: its packets as they came, and each picture as the tracker was shown it."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Final, NamedTuple

import msgspec

from gcs.errors import VideoError, one_line
from gcs.recorder.film_index import INDEX, PacketRow, StreamRow
from gcs.regular_file import open_regular
from gcs.video.frame import Image
from gcs.video.picture_decoder import PictureDecoder, open_decoder
from gcs.video.tap import Coding

_FAR: Final = 300  # packets; further on, a key frame near the wanted picture is the quicker way to it
_TRIES: Final = 3  # key frames gone back to: pictures come later than their packets where some wait for others
_LOOKED_AT: Final = 500  # packets, for the size of the first picture


class FilmPacket(NamedTuple):
    """data: as the decoder was given it; H.264 and H.265 as Annex B. coding: of its connection."""

    number: int
    t_arrival_s: float
    is_key: bool
    data: bytes
    coding: Coding


@dataclass(frozen=True, slots=True)
class _Place:
    """A packet; begin: place of the first one that it can be decoded after, without a gap between."""

    row: PacketRow
    stream: StreamRow
    begin: int


class FilmReader:
    """Not to be shared between threads. Of a film broken off anywhere, all packets that are whole.

    problem: in one line, why there is no film, or not all of it.
    """

    def __init__(self, folder: Path) -> None:
        self.problem: str | None = None
        self._folder = folder
        self._places: list[_Place] = []
        self._files: dict[str, IO[bytes]] = {}
        self._sizes: dict[str, int] = {}
        self._decoder: PictureDecoder | None = None
        self._at = -1  # place of the packet decoded last
        self._held: Image | None = None  # the picture of that place, once it was wanted
        try:
            self._read_index()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            is_there = (folder / INDEX).exists()
            self.problem = f"{error.filename}: {reason}" if is_there else f"{folder}: no film in it"
        self._numbers = [place.row.n for place in self._places]
        self._keys = [at for at, place in enumerate(self._places) if place.row.key or place.begin == at]

    def _read_index(self) -> None:
        """Raises OSError."""
        decode = msgspec.json.Decoder(StreamRow | PacketRow).decode
        stream, has_begun, damaged = None, False, 0
        with open_regular(self._folder / INDEX) as file:
            for line in file:
                try:
                    row = decode(line)
                    if isinstance(row, StreamRow):
                        stream, has_begun = self._checked(row), False
                        continue
                    if stream is None or row.n < 0:
                        raise ValueError
                except (msgspec.DecodeError, ValueError, RecursionError):
                    damaged += line.endswith(b"\n")
                    continue
                if self._holds(stream, row):
                    self._place(stream, row, has_begun)
                    has_begun = True
        if damaged:
            self.problem = f"{self._folder / INDEX}: {damaged} of its lines cannot be read: their pictures are missing"
        elif not self._places and self.problem is None:
            self.problem = f"{self._folder / INDEX}: no packet of its film is there"

    def _checked(self, row: StreamRow) -> StreamRow:
        """Raises OSError without the file, ValueError for a name that is none of a film."""
        if row.file not in self._files:
            if Path(row.file).name != row.file or not row.file.startswith("film"):
                raise ValueError
            path = self._folder / row.file
            self._files[row.file], self._sizes[row.file] = open_regular(path), path.stat().st_size
        return row

    def _holds(self, stream: StreamRow, row: PacketRow) -> bool:
        end = self._sizes[stream.file]
        return 0 <= row.at <= end and 0 <= row.size <= end - row.at

    def _place(self, stream: StreamRow, row: PacketRow, follows: bool) -> None:
        last = self._places[-1] if self._places else None
        if last is not None and row.n <= last.row.n:
            return
        is_next = follows and last is not None and row.n == last.row.n + 1
        begin = last.begin if last is not None and is_next else len(self._places)
        self._places.append(_Place(row, stream, begin))

    def __len__(self) -> int:
        """How many packets there are."""
        return len(self._places)

    @property
    def codec(self) -> str | None:
        """Of the first packet, as FFmpeg names it; None without any."""
        return self._places[0].stream.codec if self._places else None

    @property
    def is_exact(self) -> bool:
        """Whether it is what the tracker was shown, to the last bit, and not pictures encoded for the film."""
        return bool(self._places) and not any(place.stream.lossy for place in self._places)

    @property
    def parameter_sets(self) -> bytes:
        """What the first connection said before its packets, as Annex B; empty where all is in the packets."""
        return self._places[0].stream.extradata if self._places else b""

    @cached_property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the first picture, px; None where there is none."""
        for number in self._numbers[:_LOOKED_AT]:
            image_bgr = self.picture(number)
            if image_bgr is not None:
                return image_bgr.shape[1], image_bgr.shape[0]
        return None

    def packets(self) -> Iterator[FilmPacket]:
        """All, in order."""
        for place in self._places:
            row = place.row
            yield FilmPacket(row.n, row.t_arrival_s, row.key, self._data(place), place.stream.coding)

    def picture(self, packet: int) -> Image | None:
        """(height, width, 3) BGR, the newest of those that this packet completed; None where there is none.

        Quick for one packet after the other, and then exactly what the tracker was shown. Going back, or far ahead,
        begins at a key frame; of a stream whose pictures lean on some before it, the first ones then differ.
        """
        wanted = bisect_left(self._numbers, packet)
        if wanted == len(self._numbers) or self._numbers[wanted] != packet:
            return None
        try:
            if self._leads_to(wanted):
                self._go_on(wanted)
            elif wanted != self._at:
                self._begin_before(wanted)
        except (VideoError, OSError) as error:
            self.problem = self.problem or one_line(error)
            self._at, self._decoder, self._held = -1, None, None
        return self._held

    def _leads_to(self, wanted: int) -> bool:
        begin = self._places[wanted].begin
        if self._decoder is None or not begin <= self._at < wanted:
            return False
        return wanted - self._at <= _FAR or self._keys_to(wanted)[0] <= self._at

    def _keys_to(self, wanted: int) -> list[int]:
        """Places to begin at, the nearest first; at least one."""
        begin, end = self._places[wanted].begin, bisect_right(self._keys, wanted)
        return [key for key in reversed(self._keys[max(0, end - _TRIES) : end]) if key >= begin]

    def _begin_before(self, wanted: int) -> None:
        for key in self._keys_to(wanted):
            stream = self._places[key].stream
            self._decoder, self._at = open_decoder(str(self._folder / stream.file), stream.coding), key - 1
            self._go_on(wanted)
            if self._held is not None:
                return

    def _go_on(self, wanted: int) -> None:
        assert self._decoder is not None
        for place in self._places[self._at + 1 : wanted + 1]:
            self._decoder.take(self._data(place), is_key=place.row.key, skips=place.row.skips)
        self._at, self._held = wanted, self._decoder.picture()

    def _data(self, place: _Place) -> bytes:
        file = self._files[place.stream.file]
        file.seek(place.row.at)
        return file.read(place.row.size)

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()
