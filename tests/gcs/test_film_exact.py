"""What a live source showed is in its film to the last bit: real streams, joined late, damaged, broken and too fast."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs.recorder.film import Film
from gcs.recorder.film_reader import FilmReader
from gcs.video import VideoSource, open_source
from gcs.video import live as live_module
from gcs.video import packets as packets_module
from gcs.video import pyav as pyav_module
from gcs.video.decoding import PacketDecoder
from gcs.video.pyav import is_installed
from tests.gcs import clips
from tests.gcs.bad_relay import BadRelay
from tests.gcs.film_rig import assert_exact, filmed, frames_of
from tests.gcs.mjpeg_server import MjpegServer
from tests.gcs.rtsp_server import RtspServer
from tests.gcs.stream_sender import StreamSender, free_port

needs_av = pytest.mark.skipif(not is_installed(), reason="sending a stream needs PyAV")
B_FRAMES = {"preset": "medium", "bf": "3", "x264-params": "repeat-headers=1:rc-lookahead=4:sync-lookahead=0"}
NO_HINT = {"preset": "ultrafast", "tune": "zerolatency", "bf": "2", "x264-params": "repeat-headers=1:open-gop=1"}
REFRESH = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "repeat-headers=1:intra-refresh=1:keyint=20"}


def test_mjpeg(tmp_path: Path) -> None:
    server, film = MjpegServer(), Film(tmp_path)
    for index in range(20):
        server.send(clips.picture(index))
        if index == 10:
            server.send_bytes(b"\xff\xd8 no picture")
    source = open_source(server.url, reconnect=False, tap=film)
    try:
        reader = assert_exact(tmp_path, filmed(tmp_path, film, source, 3))
    finally:
        server.close()
    assert reader.codec == "mjpeg"


@needs_av
@pytest.mark.parametrize(
    ("form", "codec", "options"),
    [
        ("mpegts", "libx264", {}),
        ("mpegts", "libx264", {"x264-params": "repeat-headers=1:slices=4"}),
        ("mpegts", "libx264", B_FRAMES),
        ("mpegts", "libx264", NO_HINT),
        ("mpegts", "libx264", REFRESH),
        ("mpegts", "libx265", {"preset": "ultrafast", "x265-params": "log-level=none:keyint=10:bframes=2"}),
        ("mpegts", "mpeg2video", {}),
        ("rtp", "libx264", {}),
        ("rtp", "libx264", B_FRAMES),
    ],
)
def test_streams_joined_in_the_middle(form: str, codec: str, options: dict[str, str], tmp_path: Path) -> None:
    port, film = free_port(), Film(tmp_path)
    with StreamSender(form, port, codec=codec, options=options):
        time.sleep(0.3)
        address = f"{'udp' if form == 'mpegts' else 'rtp'}://127.0.0.1:{port}"
        source = open_source(address, reconnect=False, tap=film)
        frames = filmed(tmp_path, film, source, 40)
    assert len(frames) == 40
    assert_exact(tmp_path, frames)


@needs_av
def test_a_stream_that_opencv_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It gives no packets: the film is nearly what was tracked, and says so."""
    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: False)
    port, film = free_port(), Film(tmp_path)
    with StreamSender("mpegts", port):
        source = open_source(f"udp://127.0.0.1:{port}", reconnect=False, tap=film)
        frames = filmed(tmp_path, film, source, 10)
    reader = FilmReader(tmp_path)
    assert (reader.codec, reader.is_exact) == ("mjpeg", False)
    for frame in frames:
        assert frame.packet is not None
        image_bgr = reader.picture(frame.packet)
        assert image_bgr is not None
        assert np.abs(image_bgr.astype(int) - frame.image_bgr).mean() < 4


@needs_av
def test_rtsp(tmp_path: Path) -> None:
    server, film = RtspServer(), Film(tmp_path)
    try:
        assert_exact(tmp_path, filmed(tmp_path, film, open_source(server.url, reconnect=False, tap=film), 25))
    finally:
        server.close()


@needs_av
@pytest.mark.parametrize("form", ["mpegts", "rtp"])
@pytest.mark.parametrize(
    "harm", [{"lost": 0.05}, {"swapped": 0.03}, {"damaged": 0.05}], ids=lambda harm: next(iter(harm))
)
def test_what_a_bad_radio_leaves(form: str, harm: dict[str, float], tmp_path: Path) -> None:
    """Torn and grey pictures are tracked like others, so they must be the same again."""
    port, film = free_port(), Film(tmp_path)
    with BadRelay(port, **harm) as relay, StreamSender(form, relay.port, picture=moving):
        address = f"{'udp' if form == 'mpegts' else 'rtp'}://127.0.0.1:{port}"
        source = open_source(address, tap=film)
        relay.is_bad = True
        frames = filmed(tmp_path, film, source, 60)
        assert relay.harmed > 5
    assert_exact(tmp_path, frames, backwards=False)  # what hides a hole is older than the key frame


def moving(number: int, size: tuple[int, int]) -> clips.Picture:
    """Larger when encoded than a datagram."""
    noise = np.random.default_rng(number % 50).integers(0, 255, (size[1] // 8, size[0] // 8, 3), np.uint8)
    return np.asarray(cv2.resize(noise, size), np.uint8)


@needs_av
def test_rtmp_says_its_parameters_otherwise(tmp_path: Path) -> None:
    """FLV, as RTMP brings it, has lengths in the place of start codes; the film has what players take."""
    port, film = free_port(), Film(tmp_path)
    with StreamSender("flv", port, options={"x264-params": "repeat-headers=0"}):
        source = open_source(f"tcp://127.0.0.1:{port}", reconnect=False, tap=film)
        frames = filmed(tmp_path, film, source, 40)
    reader = assert_exact(tmp_path, frames)
    assert all(packet.data.startswith((b"\0\0\1", b"\0\0\0\1")) for packet in reader.packets())
    assert is_played(tmp_path / "film.h264") > 30


def is_played(path: Path) -> int:
    """How many pictures a player gets out of this file."""
    import av

    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


@needs_av
def test_a_decoder_that_is_behind_skips_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decode, port, film = PacketDecoder.decode, free_port(), Film(tmp_path)
    skipped: list[bool] = []

    def slowly(decoder: PacketDecoder, data: bytes, *, is_key: bool, skips: bool) -> list[object]:
        time.sleep(0.03)
        skipped.append(skips)
        return decode(decoder, data, is_key=is_key, skips=skips)

    monkeypatch.setattr(PacketDecoder, "decode", slowly)
    monkeypatch.setattr(packets_module, "BEHIND_S", 0.05)
    with StreamSender("mpegts", port, gop=30, options=B_FRAMES):
        source = open_source(f"udp://127.0.0.1:{port}", reconnect=False, tap=film)
        frames = filmed(tmp_path, film, source, 50)
    assert any(skipped)
    assert not all(skipped)
    monkeypatch.setattr(PacketDecoder, "decode", decode)
    assert_exact(tmp_path, frames)


@needs_av
def test_a_camera_that_comes_back_with_another_codec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One number counts the packets of all connections; each codec has a file."""
    for module in (pyav_module, packets_module):
        monkeypatch.setattr(module, "SILENT_S", 0.4)
    monkeypatch.setattr(live_module, "FIRST_BACKOFF_S", 0.02)
    port, film, frames = free_port(), Film(tmp_path), []
    source: VideoSource | None = None
    for codec in ("libx264", "mpeg2video", "libx264"):
        with StreamSender("mpegts", port, codec=codec):
            source = source or open_source(f"udp://127.0.0.1:{port}", tap=film)
            while (frame := source.read(5.0)) is None:
                assert not source.ended
            frames += [frame, *frames_of(source, 20)]
        while "nothing came" not in source.trouble:
            source.read(0.1)
    assert source is not None
    source.close()
    film.close()
    reader = assert_exact(tmp_path, frames)
    assert len(frames) == 63
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film-2.m2v", "film.h264", "film.jsonl"]
    assert reader.codec == "h264"


@needs_av
@pytest.mark.parametrize(("codec", "suffix"), [("libx264", "h264"), ("libx265", "h265"), ("mpeg2video", "m2v")])
def test_a_player_takes_the_film(codec: str, suffix: str, tmp_path: Path) -> None:
    port, film = free_port(), Film(tmp_path)
    options = {"preset": "ultrafast", "x265-params": "log-level=none"} if codec == "libx265" else None
    with StreamSender("mpegts", port, codec=codec, options=options):
        filmed(tmp_path, film, open_source(f"udp://127.0.0.1:{port}", reconnect=False, tap=film), 30)
    assert is_played(tmp_path / f"film.{suffix}") >= 30
