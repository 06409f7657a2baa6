"""Live sources over real sockets: Motion JPEG, refusals, silence."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
import pytest

from gcs.errors import VideoError
from gcs.video import live as live_module
from gcs.video import mjpeg as mjpeg_module
from gcs.video import open_source
from gcs.video import opencv as opencv_module
from gcs.video.mjpeg import jpeg_size
from gcs.video.pyav import is_installed
from tests.gcs.clips import SIZE, picture
from tests.gcs.mjpeg_server import MjpegServer


@pytest.fixture(params=[True, False], ids=["with length", "without length"])
def server(request: pytest.FixtureRequest) -> Iterator[MjpegServer]:
    server = MjpegServer(with_length=request.param)
    yield server
    server.close()


def test_mjpeg_over_a_real_socket(server: MjpegServer) -> None:
    server.send(picture(0))
    source = open_source(server.url.replace("http://", "http://pilot:s3cret@"), reconnect=False)
    assert source.size == SIZE
    assert source.is_live
    assert "s3cret" not in source.name
    assert server.authorization == "Basic cGlsb3Q6czNjcmV0"
    assert source.read(5.0) is not None
    server.send_bytes(b"\xff\xd8 not a jpeg at all \xff\xd9")
    server.send(picture(5))
    frame = source.read(5.0)
    assert frame is not None
    assert frame.seq == 1  # the broken picture was skipped
    assert np.abs(frame.image_bgr.astype(int) - picture(5)).mean() < 8
    server.drop()
    source.read(5.0)
    assert source.ended
    source.close()


def test_mjpeg_reconnects(server: MjpegServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "FIRST_BACKOFF_S", 0.01)
    server.send(picture(0))
    source = open_source(server.url)
    assert source.read(5.0) is not None
    server.drop()
    server.send(picture(1))
    frame = source.read(10.0)
    assert frame is not None
    assert frame.seq == 1
    assert server.connections == 2
    server.drop()
    source.close()


def test_http_refusals_are_one_line() -> None:
    server = MjpegServer(status=403)
    with pytest.raises(VideoError, match="answered 403"):
        open_source(server.url)
    server.close()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/video"
        with pytest.raises(VideoError, match="refused"):
            open_source(url)


def test_a_silent_server_times_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjpeg_module, "SILENT_S", 0.2)
    server = MjpegServer()
    with pytest.raises(VideoError, match="silent"):
        open_source(server.url)
    server.close()


@pytest.mark.parametrize("backend", ["opencv", "pyav"])
def test_a_silent_udp_port_times_out(monkeypatch: pytest.MonkeyPatch, backend: str) -> None:
    if backend == "pyav" and not is_installed():
        pytest.skip("PyAV is an optional extra")
    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: backend == "pyav")
    monkeypatch.setattr("gcs.video.pyav.OPEN_TIMEOUT_S", 0.3)
    monkeypatch.setattr(opencv_module, "OPEN_TIMEOUT_S", 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(VideoError, match=f"udp://127.0.0.1:{port}"):
        open_source(f"udp://127.0.0.1:{port}")


def test_the_size_is_known_before_decoding() -> None:
    import cv2

    data = cv2.imencode(".jpg", picture(0))[1].tobytes()
    assert jpeg_size(data) == SIZE
    assert jpeg_size(b"GIF89a") is None
    bomb = data.replace(SIZE[1].to_bytes(2, "big") + SIZE[0].to_bytes(2, "big"), b"\xff\xf0\xff\xf0", 1)
    assert jpeg_size(bomb) == (0xFFF0, 0xFFF0)
    server = MjpegServer()
    server.send_bytes(bomb)
    with pytest.raises(VideoError, match="65520x65520 px"):
        open_source(server.url)
    server.close()
