"""A video that was made elsewhere, as the film of a flight: its packets as they are, or JPEG where that cannot be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Final

import cv2

from gcs.cli.progress import shown_progress
from gcs.recorder.film_files import FilmFiles
from gcs.recorder.film_index import SUFFIXES
from gcs.video import open_source, pyav
from gcs.video.annex_b import is_annex_b, parameter_sets
from gcs.video.decoding import PacketDecoder
from gcs.video.recorded import DEFAULT_FPS
from gcs.video.tap import Coding, Library

_TRIED: Final = 64  # packets, to see how a decoder takes them
_JPEG: Final = Coding("mjpeg", Library.OPENCV)
_JPEG_QUALITY: Final = 90


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture: when, in s of the video, and the packet of the film that gives it."""

    t_s: float
    packet: int


class ImportedVideo:
    """A file that plays. size: (width, height), px. created_unix_s: as the camera says, None where it does not.

    times_s: of its pictures, from 0. Raises VideoError where it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        source = open_source(str(path))
        self.size, self.fps = source.size, source.fps
        source.close()
        self.codec = ""  # of packets that can be taken as they are
        self.created_unix_s: float | None = None
        self.times_s: list[float] = []
        self._late = 0
        if pyav.is_installed():
            self._look()
        if not self.codec:
            self._count()

    @property
    def span_s(self) -> float:
        """From the first picture to the last."""
        return self.times_s[-1] - self.times_s[0]

    def film(self, folder: Path, start_s: float) -> list[Shown]:
        """Write it; start_s: of the first picture, on the flight's clock. Raises OSError."""
        with FilmFiles(folder, _new_file) as files:
            shown = self._packets(files, start_s) if self.codec else self._jpegs(files, start_s)
            files.sync()
        return shown

    # -- as it is ----------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Take its packets as they are, if a decoder makes one picture of each, all equally late."""
        import av

        try:
            with av.open(str(self.path)) as container:
                self.created_unix_s = _created(container.metadata)
                codec = self._codec_that_keeps_step(container.streams.video[0])
            if codec:
                self.times_s, self.codec = self._packet_times_s(), codec
        except (av.FFmpegError, OSError, ValueError):
            self.codec = ""

    def _codec_that_keeps_step(self, stream: Any) -> str:
        coding = _coding(stream)
        if coding.codec not in SUFFIXES:
            return ""
        decoder, counts = PacketDecoder(coding), list[int]()
        for data, is_key in _annex_b(stream, coding, limit=_TRIED):
            counts.append(len(decoder.decode(data, is_key=is_key, skips=False)))
        self._late = counts.index(1) if 1 in counts else 0
        return coding.codec if set(counts[self._late :]) == {1} else ""

    def _packet_times_s(self) -> list[float]:
        import av

        with av.open(str(self.path)) as container:
            stream = container.streams.video[0]
            stamps = [
                packet.pts for packet in shown_progress(container.demux(stream), "looking", "packets") if packet.size
            ]
            if any(stamp is None for stamp in stamps):
                return [number / (self.fps or DEFAULT_FPS) for number in range(len(stamps))]
            stamps.sort()
            return [float((stamp - stamps[0]) * stream.time_base) for stamp in stamps]

    def _packets(self, files: FilmFiles, start_s: float) -> list[Shown]:
        """A packet arrives when the picture that it gives is due."""
        import av

        times_s, late = self.times_s, self._late
        with av.open(str(self.path)) as container:
            stream = container.streams.video[0]
            coding = _coding(stream)
            files.begin(coding, lossy=False)
            number = -1
            for number, (data, is_key) in enumerate(
                shown_progress(_annex_b(stream, coding), "video", "packets", len(times_s))
            ):
                due_s = times_s[min(max(number - late, 0), len(times_s) - 1)]
                files.add(number, data, start_s + due_s, is_key=is_key, skips=False)
            if late:  # the last picture comes when the decoder hears that there is no more
                files.add(number + 1, b"", start_s + times_s[-1], is_key=False, skips=False)
        shown = [Shown(start_s + t_s, place + late) for place, t_s in enumerate(times_s[: number + 1 - late])]
        return shown + ([Shown(start_s + times_s[-1], number + 1)] if late else [])

    # -- as pictures -------------------------------------------------------------------------------------------

    def _count(self) -> None:
        source = open_source(str(self.path))
        frames = iter(source.read, None)
        read = shown_progress(frames, "looking", "pictures", source.frame_count)
        self.times_s = [frame.t_arrival_s for frame in read if frame is not None]
        source.close()

    def _jpegs(self, files: FilmFiles, start_s: float) -> list[Shown]:
        source, shown = open_source(str(self.path)), list[Shown]()
        files.begin(_JPEG, lossy=True)
        for frame in shown_progress(iter(source.read, None), "video", "pictures", len(self.times_s)):
            assert frame is not None
            _, jpeg = cv2.imencode(".jpg", frame.image_bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
            t_s = start_s + frame.t_arrival_s
            files.add(frame.seq, jpeg.tobytes(), t_s, is_key=True, skips=False)
            shown.append(Shown(t_s, frame.seq))
        source.close()
        return shown


def _coding(stream: Any) -> Coding:
    context = stream.codec_context
    codec, extradata = context.codec.canonical_name, bytes(context.extradata or b"")
    if not is_annex_b(codec, extradata):
        extradata = parameter_sets(codec, extradata)
    return Coding(codec, Library.FFMPEG, extradata, context.reorder_depth)


def _annex_b(stream: Any, coding: Coding, limit: int | None = None) -> Iterator[tuple[bytes, bool]]:
    """The packets as a player takes them, and whether a decoder can begin with each."""
    from av.bitstream import BitStreamFilterContext

    extradata = bytes(stream.codec_context.extradata or b"")
    as_is = is_annex_b(coding.codec, extradata)
    convert = None if as_is else BitStreamFilterContext(f"{coding.codec}_mp4toannexb", stream)
    packets = (packet for packet in stream.container.demux(stream) if packet.size)
    for number, packet in enumerate(packets):
        if number == limit:
            return
        is_key = bool(packet.is_keyframe)
        yield bytes(packet) if convert is None else b"".join(map(bytes, convert.filter(packet))), is_key


def _created(metadata: dict[str, str]) -> float | None:
    """Seconds since 1970; cameras without a clock say 1904 or 1970."""
    try:
        made = datetime.fromisoformat(metadata["creation_time"].replace("Z", "+00:00"))
    except (KeyError, ValueError):
        return None
    unix_s = made.replace(tzinfo=made.tzinfo or UTC).timestamp()
    return unix_s if unix_s > 0 else None


def _new_file(path: Path) -> IO[bytes]:
    return path.open("xb")
