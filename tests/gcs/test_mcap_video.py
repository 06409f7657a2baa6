"""Films of real streams as Foxglove's messages: each decodes by itself to the picture that the tracker was shown."""

from __future__ import annotations

import time
from base64 import b64decode
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs.mcap_export.video import FilmTopics, unit_kinds
from gcs.mcap_export.writer import TopicWriter
from gcs.recorder.film import Film
from gcs.recorder.film_reader import FilmReader
from gcs.replay.log import FrameRow
from gcs.video import Frame, open_source
from gcs.video.pyav import is_installed
from gcs.video.tap import Coding, Library
from tests.gcs.film_rig import filmed
from tests.gcs.mcap_reading import read_mcap
from tests.gcs.stream_sender import SIZE, StreamSender, free_port, number_of, numbered

pytestmark = pytest.mark.skipif(not is_installed(), reason="sending a stream needs PyAV")
B_FRAMES = {"preset": "medium", "bf": "3", "x264-params": "repeat-headers=1:rc-lookahead=4:sync-lookahead=0"}
REFRESH = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "repeat-headers=1:intra-refresh=1:keyint=20"}
H265 = {"preset": "ultrafast", "x265-params": "log-level=none:keyint=10:bframes=0:repeat-headers=1"}


def received(folder: Path, form: str, codec: str, options: dict[str, str]) -> list[Frame]:
    """Filmed in this folder, from some moment of a stream on."""
    port, film = free_port(), Film(folder)
    with StreamSender(form, port, codec=codec, options=options):
        time.sleep(0.3)
        address = f"{'udp' if form == 'mpegts' else 'rtp'}://127.0.0.1:{port}"
        return filmed(folder, film, open_source(address, reconnect=False, tap=film), 40)


def exported(folder: Path) -> tuple[dict[str, list[tuple[int, Any]]], FilmTopics]:
    """The film of a folder by topic, and what stamps boxes."""
    film, path = FilmReader(folder), folder / "film.mcap"
    with path.open("wb") as file:
        writer = TopicWriter(file, lambda t_s: t_s)
        topics = FilmTopics(writer, film)
        for packet in film.packets():
            topics.add(packet)
        writer.finish()
    return read_mcap(path)[0], topics


def stamp_of(frame: Frame, topics: FilmTopics) -> float:
    row = FrameRow(frame.t_capture_s, frame.t_arrival_s, 0.0, packet=frame.packet)
    return topics.shown_s(row)


@pytest.mark.parametrize(
    ("form", "codec", "options"), [("mpegts", "libx264", {}), ("rtp", "libx264", {}), ("mpegts", "libx265", H265)]
)
def test_streams_go_as_they_came(form: str, codec: str, options: dict[str, str], tmp_path: Path) -> None:
    import av

    frames = received(tmp_path, form, codec, options)
    messages, topics = exported(tmp_path)
    assert topics.note is None
    assert set(messages) == {"/camera/video"}
    name = "h264" if codec == "libx264" else "hevc"
    first = b64decode(messages["/camera/video"][0][1]["data"])
    assert unit_kinds(name, first) >= ({5, 7, 8} if name == "h264" else {32, 33, 34})
    context = av.CodecContext.create(name, "r")
    context.flags |= int(av.codec.context.Flags.low_delay)
    shown = {}
    for ns, message in messages["/camera/video"]:
        assert message["format"] == {"h264": "h264", "hevc": "h265"}[name]
        pictures = context.decode(av.Packet(b64decode(message["data"])))
        assert len(pictures) == 1, "one message, one picture"
        shown[ns] = number_of(pictures[0].to_ndarray(format="bgr24"))
    stamped = [(round(stamp_of(frame, topics) * 1e9), number_of(frame.image_bgr)) for frame in frames]
    there = [(ns, number) for ns, number in stamped if ns in shown]
    assert len(there) > 25, "those before the first key frame are not there"
    assert [shown[ns] for ns, _ in there] == [number for _, number in there]


def test_parameters_told_beside_the_stream_go_into_it(tmp_path: Path) -> None:
    """As RTSP cameras tell them, once."""
    import av

    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height = SIZE
    encoder.pix_fmt, encoder.framerate, encoder.time_base, encoder.gop_size = "yuv420p", 20, Fraction(1, 20), 10
    encoder.flags |= int(av.codec.context.Flags.global_header)
    encoder.options = {"preset": "ultrafast", "tune": "zerolatency"}
    encoder.open()
    film = Film(tmp_path)
    film.opened(Coding("h264", Library.FFMPEG, bytes(encoder.extradata)))
    for number in range(30):
        for packet in encoder.encode(av.VideoFrame.from_ndarray(numbered(number), format="bgr24")):
            film.packet(bytes(packet), number / 20, is_key=packet.is_keyframe)
    film.close()
    messages, topics = exported(tmp_path)
    assert topics.note is None
    assert len(messages["/camera/video"]) == 30
    keys = [kinds for _, message in messages["/camera/video"] if 5 in (kinds := units(message))]
    assert len(keys) == 3
    assert all({7, 8} <= kinds for kinds in keys)


def units(message: dict[str, Any]) -> set[int]:
    return unit_kinds("h264", b64decode(message["data"]))


@pytest.mark.parametrize(
    ("codec", "options", "said"),
    [("libx264", B_FRAMES, "B-frames"), ("libx264", REFRESH, "without key frames"), ("mpeg2video", {}, "mpeg2video")],
)
def test_what_foxglove_does_not_play_goes_as_jpeg(
    codec: str, options: dict[str, str], said: str, tmp_path: Path
) -> None:
    frames = received(tmp_path, "mpegts", codec, options)
    messages, topics = exported(tmp_path)
    assert topics.note is not None
    assert said in topics.note
    assert set(messages) == {"/camera/image"}
    shown = {ns: message["data"] for ns, message in messages["/camera/image"]}
    for frame in frames[-20:]:
        jpeg = np.frombuffer(b64decode(shown[round(stamp_of(frame, topics) * 1e9)]), np.uint8)
        image = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
        assert image is not None
        assert number_of(np.asarray(image, np.uint8)) == number_of(frame.image_bgr)
