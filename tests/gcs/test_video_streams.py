"""Live streams as cameras send them, by both readers: MPEG-TS over UDP, RTP, RTSP over TCP; and what goes wrong."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs.errors import VideoError
from gcs.video import VideoSource, open_source
from gcs.video import live as live_module
from gcs.video import packets as packets_module
from gcs.video import pyav as pyav_module
from gcs.video.decoding import PacketDecoder
from gcs.video.live import LiveSource
from gcs.video.packets import PacketQueue
from gcs.video.pyav import is_installed
from tests.gcs import clips
from tests.gcs.rtsp_server import RtspServer
from tests.gcs.stream_sender import SIZE, StreamSender, free_port, number_of, numbered, write_sdp
from tests.gcs.waiting import wait_for

pytestmark = pytest.mark.skipif(not is_installed(), reason="sending a stream needs PyAV")


@pytest.fixture(params=["opencv", "pyav"])
def backend(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: request.param == "pyav")
    return str(request.param)


def numbers(source: VideoSource, count: int) -> list[int]:
    """What the next pictures say."""
    found = []
    for _ in range(count):
        frame = source.read(5.0)
        assert frame is not None
        found.append(number_of(frame.image_bgr))
    return found


@pytest.mark.parametrize("kind", ["udp", "rtp", "sdp"])
def test_a_stream_that_is_joined_in_the_middle(kind: str, backend: str, tmp_path: Path) -> None:
    port = free_port()
    address = str(write_sdp(tmp_path / "camera.sdp", port)) if kind == "sdp" else f"{kind}://127.0.0.1:{port}"
    with StreamSender("mpegts" if kind == "udp" else "rtp", port):
        source = open_source(address, reconnect=False)
        assert (source.size, source.is_live) == (SIZE, True)
        seen = numbers(source, 6)
        assert seen == sorted(set(seen))
        source.close()


def test_rtsp_over_tcp(backend: str) -> None:
    server = RtspServer()
    try:
        source = open_source(server.url, reconnect=False)
        seqs = [frame.seq for frame in (source.read(5.0) for _ in range(4)) if frame is not None]
        assert len(seqs) == 4
        assert seqs == sorted(set(seqs))
        assert source.size == clips.SIZE
        assert server.packets > 0
        source.close()
    finally:
        server.close()


def test_pictures_of_mpegts_are_whole() -> None:
    """Nothing parses them: slices must become one picture, and so must one that FFmpeg cuts in pieces."""
    port, noise = free_port(), np.random.default_rng(1).integers(60, 160, (270, 480, 3), np.uint8)
    ground = cv2.resize(noise, (1920, 1080), interpolation=cv2.INTER_NEAREST)

    def picture(number: int, size: tuple[int, int]) -> clips.Picture:
        image = np.roll(ground, 8 * number, axis=1)
        image[: size[1] // 4] = numbered(number, size)[: size[1] // 4]
        return image

    options = {"x264-params": "repeat-headers=1:slices=4:qp=30"}
    errors = []
    with StreamSender("mpegts", port, size=(1920, 1080), fps=8, gop=1, options=options, picture=picture) as sender:
        source = open_source(f"udp://127.0.0.1:{port}", reconnect=False)
        for _ in range(3):
            frame = source.read(5.0)
            assert frame is not None
            truth = picture(number_of(frame.image_bgr), sender.size)
            # The lower end of the picture is the last that comes.
            errors.append(np.abs(frame.image_bgr[-200:].astype(int) - truth[-200:]).mean())
        source.close()
    assert sender.largest_bytes > 205_000  # more than a piece
    assert min(errors) < 12


@pytest.mark.parametrize("form", ["mpegts", "rtp"])
def test_a_sender_that_comes_back_is_seen_again(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (pyav_module, packets_module):
        monkeypatch.setattr(module, "SILENT_S", 0.4)
    monkeypatch.setattr(live_module, "FIRST_BACKOFF_S", 0.02)
    port = free_port()
    with StreamSender(form, port):
        source = open_source(f"{'udp' if form == 'mpegts' else 'rtp'}://127.0.0.1:{port}")
        assert isinstance(source, LiveSource)
        numbers(source, 2)
    wait_for(lambda: "nothing came" in source.trouble)
    assert source.trouble.endswith("; trying again")
    with StreamSender(form, port):
        while source.read(5.0) is None:
            assert not source.ended
        wait_for(lambda: source.trouble == "")
        source.close()
    assert source.reconnects >= 1


def test_sound_alone_is_no_video(tmp_path: Path, backend: str) -> None:
    path = sound(tmp_path / "sound.mp4")
    expected = "holds no video, only audio" if backend == "pyav" else "not a video"
    with pytest.raises(VideoError, match=expected):
        open_source(str(path))


def sound(path: Path) -> Path:
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        container.mux([*stream.encode(frame), *stream.encode(None)])
    return path


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("rtp://127.0.0.1", "an RTP address is rtp://HOST:PORT"),
        ("rtp://127.0.0.1:99999", "an RTP address is rtp://HOST:PORT"),
        ("rtp://127.0.0.1:5600?codec=theora", "an RTP address is rtp://HOST:PORT"),
        ("rtp://127.0.0.1:5600?payload=33", "an RTP address is rtp://HOST:PORT"),
        ("rtsp://127.0.0.1:1/x?transport=carrier-pigeon", "transport is tcp or udp"),
        ("missing.sdp", "missing.sdp: no such file"),
        ("camera:0?brightness=3", "a camera takes width, height, fps"),
        ("camera:0?width=wide", "a camera takes width, height, fps"),
        ("camera:98?width=640&height=480&format=MJPG", "camera:98: no such camera"),
    ],
)
def test_addresses_that_cannot_be_opened_say_why(address: str, reason: str, backend: str) -> None:
    with pytest.raises(VideoError, match=reason):
        open_source(address)


def test_a_server_that_stalls_within_a_picture_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.video.mjpeg.SILENT_S", 0.2)
    picture = cv2.imencode(".jpg", numbered(1))[1].tobytes()
    part = b"--frame\r\nContent-Length: %d\r\n\r\n" % len(picture) + picture + b"\r\n"
    listener, done = socket.create_server(("127.0.0.1", 0)), threading.Event()

    def serve() -> None:
        client, _ = listener.accept()
        with client:
            client.recv(4096)
            client.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace\r\n\r\n" + part + part[:500])
            done.wait(5.0)

    server = threading.Thread(target=serve)
    server.start()
    source = open_source(f"http://127.0.0.1:{listener.getsockname()[1]}/", reconnect=False)
    assert source.read(1.0) is not None
    assert source.read(5.0) is None
    assert source.ended
    assert source.problem is not None
    assert "silent" in source.problem
    source.close()
    done.set()
    server.join()
    listener.close()


def test_a_decoder_that_is_too_slow_gives_new_pictures_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice too slow: without dropping, pictures would be a second old after two."""
    monkeypatch.setattr(live_module, "BEHIND_S", 0.06)
    decode, port = PacketDecoder.decode, free_port()

    def slowly(decoder: PacketDecoder, data: bytes, **how: bool) -> list[object]:
        time.sleep(0.04)
        return decode(decoder, data, **how)

    monkeypatch.setattr(PacketDecoder, "decode", slowly)
    with StreamSender("mpegts", port, fps=50.0, gop=5) as sender:
        source = open_source(f"udp://127.0.0.1:{port}", reconnect=False)
        assert isinstance(source, LiveSource)
        wait_for(lambda: "decoding is" in source.trouble)
        wait_for(lambda: len(sender.sent_s) > 80)
        behind = len(sender.sent_s) - numbers(source, 1)[0]
        source.close()
    assert behind < 40


def test_what_waits_too_long_makes_room_for_the_next_key_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    class Packet:
        def __init__(self, data: bytes, is_keyframe: bool = False) -> None:
            self.data, self.is_keyframe = data, is_keyframe

        def __bytes__(self) -> bytes:
            return self.data

    finished = threading.Event()
    picture, key = b"\0\0\0\1\x41", b"\0\0\0\1\x67"
    sent = [Packet(picture), Packet(key), Packet(picture), Packet(b"", True), Packet(picture), Packet(picture)]
    queue = PacketQueue(iter(sent), finished.set, "test")
    wait_for(lambda: len(queue._waiting) == len(sent))
    assert queue.get()[0] is sent[0]
    monkeypatch.setattr(packets_module, "BEHIND_S", -1.0)  # now everything waits too long
    assert queue.is_behind
    assert queue.get()[0] is sent[3]
    assert queue.get()[0] is sent[4]
    assert queue.get()[0] is sent[5]
    with pytest.raises(StopIteration):
        queue.get()
    assert not finished.is_set()
    queue.close()
    assert finished.wait(5.0)
