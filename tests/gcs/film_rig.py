"""Films as a live source leaves them, and whether each of its pictures is in its film."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2

from gcs.recorder.film import Film
from gcs.recorder.film_reader import FilmReader
from gcs.video.frame import Frame, VideoSource, fingerprint
from tests.gcs import clips


def frames_of(source: VideoSource, count: int) -> list[Frame]:
    """The next ones, fewer where the source ends."""
    found: list[Frame] = []
    while len(found) < count:
        frame = source.read(5.0)
        if frame is None:
            break
        found.append(frame)
    return found


def assert_exact(folder: Path, frames: list[Frame], *, exact: bool = True, backwards: bool = True) -> FilmReader:
    """Every frame has its picture in the film of this folder, asked for forwards, and backwards too."""
    reader = FilmReader(folder)
    assert reader.problem is None
    assert reader.is_exact == exact
    shape = frames[0].image_bgr.shape
    assert reader.size == (shape[1], shape[0])
    for frame in frames:
        assert_same(reader, frame)
    for frame in reversed(frames[::7] if backwards else []):
        assert_same(reader, frame)
    return reader


def assert_same(reader: FilmReader, frame: Frame) -> None:
    """To the last bit."""
    assert frame.packet is not None
    image_bgr = reader.picture(frame.packet)
    assert image_bgr is not None, f"no picture of packet {frame.packet}, frame {frame.seq}"
    assert fingerprint(image_bgr) == fingerprint(frame.image_bgr), f"packet {frame.packet}, frame {frame.seq}"


def filmed(folder: Path, film: Film, source: VideoSource, count: int) -> list[Frame]:
    """So many frames of a source that this film taps; both are closed."""
    frames = frames_of(source, count)
    source.close()
    film.close()
    assert (film.problem, film.dropped) == (None, 0)
    return frames


@dataclass(frozen=True, slots=True)
class Packet:
    """What goes into a decoder."""

    data: bytes
    is_key: bool


def jpegs(count: int) -> list[Packet]:
    """As an MJPEG camera sends them."""
    encoded = (cv2.imencode(".jpg", clips.picture(index))[1] for index in range(count))
    return [Packet(data.tobytes(), True) for data in encoded]


def h264(count: int, gop: int = 10) -> list[Packet]:
    """So many pictures, one key frame in `gop`. Needs PyAV."""
    import av

    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt, context.gop_size = *clips.SIZE, "yuv420p", gop
    context.time_base = Fraction(1, 25)
    context.options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "repeat-headers=1"}
    packets = []
    for index in range(count):
        frame = av.VideoFrame.from_ndarray(clips.picture(index), format="bgr24")
        frame.pts = index
        packets += context.encode(frame)
    return [Packet(bytes(packet), packet.is_keyframe) for packet in packets]


def feed(film: Film, packets: list[Packet], first_s: float = 0.0) -> list[int]:
    """Through the tap at 25 a second; the numbers they got."""
    return [film.packet(packet.data, first_s + at / 25, is_key=packet.is_key) for at, packet in enumerate(packets)]
