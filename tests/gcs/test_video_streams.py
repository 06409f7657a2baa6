"""Live streams as cameras send them, by both readers: MPEG-TS over UDP, RTSP over TCP."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest

from gcs.video import open_source
from gcs.video.pyav import is_installed
from tests.gcs.clips import SIZE, picture
from tests.gcs.rtsp_server import RtspServer


@pytest.mark.skipif(not is_installed(), reason="sending a stream needs PyAV")
@pytest.mark.parametrize("backend", ["opencv", "pyav"])
def test_mpegts_over_udp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: str) -> None:
    import av

    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: backend == "pyav")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{probe.getsockname()[1]}"
    stop = threading.Event()

    def send() -> None:
        output = av.open(f"{url}?pkt_size=1316", "w", format="mpegts")
        stream = output.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.gop_size = *SIZE, "yuv420p", 5
        index = 0
        while not stop.wait(0.01):
            frame = av.VideoFrame.from_ndarray(picture(index % 40), format="bgr24")
            for packet in stream.encode(frame):
                output.mux(packet)
            index += 1
        output.close()

    sender = threading.Thread(target=send)
    sender.start()
    try:
        source = open_source(url, reconnect=False)
        seqs = []
        for _ in range(5):
            frame = source.read(5.0)
            assert frame is not None
            seqs.append(frame.seq)
        assert seqs == sorted(set(seqs))
        assert source.size == SIZE
        source.close()  # while the sender still sends: our thread ends at the next frame
    finally:
        stop.set()
        sender.join()


@pytest.mark.skipif(not is_installed(), reason="the test's server needs PyAV")
@pytest.mark.parametrize("backend", ["opencv", "pyav"])
def test_rtsp_over_tcp(monkeypatch: pytest.MonkeyPatch, backend: str) -> None:
    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: backend == "pyav")
    server = RtspServer()
    try:
        source = open_source(server.url, reconnect=False)
        seqs = [frame.seq for frame in (source.read(5.0) for _ in range(4)) if frame is not None]
        assert len(seqs) == 4
        assert seqs == sorted(set(seqs))
        assert source.size == SIZE
        assert server.packets > 0
        source.close()
    finally:
        server.close()
