"""A tiny RTSP server: one client, MPEG video in RTP over the RTSP connection itself (interleaved TCP)."""

from __future__ import annotations

import socket
import threading

from tests.gcs.clips import SIZE, picture

SDP = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nt=0 0\r\nm=video 0 RTP/AVP 32\r\na=control:track0\r\n"
METHODS = "OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN"


class RtspServer:
    """Serves the generated clip at `url` until `close`; `packets` counts what was sent."""

    def __init__(self) -> None:
        self.packets = 0
        self._stop = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._rtp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._rtp.bind(("127.0.0.1", 0))
        self._rtp.settimeout(0.2)
        self.url = f"rtsp://127.0.0.1:{self._listener.getsockname()[1]}/live"
        self._threads = [threading.Thread(target=self._serve, daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        self._stop.set()
        self._listener.close()
        for thread in self._threads:
            thread.join(5.0)
        self._rtp.close()

    def _serve(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        with client, client.makefile("rwb") as stream:
            while self._answer(stream):
                pass
            encoder = threading.Thread(target=self._encode, daemon=True)
            self._threads.append(encoder)
            encoder.start()
            self._forward(client)

    def _answer(self, stream: object) -> bool:
        """Answer one request; False after PLAY."""
        lines = []
        while (line := stream.readline().decode().strip()) != "":  # type: ignore[attr-defined]
            lines.append(line)
        method = lines[0].split()[0]
        sequence = next(line for line in lines if line.lower().startswith("cseq"))
        body = SDP if method == "DESCRIBE" else ""
        extra = {
            "OPTIONS": f"Public: {METHODS}\r\n",
            "DESCRIBE": f"Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n",
            "SETUP": "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n",
            "PLAY": "Session: 1\r\n",
        }.get(method, "")
        stream.write(f"RTSP/1.0 200 OK\r\n{sequence}\r\n{extra}\r\n{body}".encode())  # type: ignore[attr-defined]
        stream.flush()  # type: ignore[attr-defined]
        return method != "PLAY"

    def _encode(self) -> None:
        import av

        port = self._rtp.getsockname()[1]
        output = av.open(f"rtp://127.0.0.1:{port}?pkt_size=1200", "w", format="rtp")
        stream = output.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.gop_size = *SIZE, "yuv420p", 5
        index = 0
        while not self._stop.wait(0.01):
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture(index % 40), format="bgr24")):
                output.mux(packet)
            index += 1
        output.close()

    def _forward(self, client: socket.socket) -> None:
        while not self._stop.is_set():
            try:
                packet = self._rtp.recv(2048)
                client.sendall(b"$\x00" + len(packet).to_bytes(2, "big") + packet)
            except TimeoutError:
                continue
            except OSError:
                return
            self.packets += 1
