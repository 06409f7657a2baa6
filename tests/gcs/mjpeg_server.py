"""A tiny MJPEG server that sends a picture only when the test says so."""

from __future__ import annotations

import queue
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2

from tests.gcs.clips import Picture


class MjpegServer:
    """`send` one picture or raw bytes; `drop` the connection. Each is delivered to the oldest open client."""

    def __init__(self, *, with_length: bool = True, status: int = 200, kind: str = "multipart") -> None:
        self.parts: queue.Queue[bytes | None] = queue.Queue()
        self.connections = 0
        self.authorization: str | None = None
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *args: object) -> None:
                pass

            def do_GET(self) -> None:
                outer.connections += 1
                outer.authorization = self.headers.get("Authorization")
                self.send_response(status)
                content = "multipart/x-mixed-replace; boundary=frame" if kind == "multipart" else kind
                self.send_header("Content-Type", content)
                self.end_headers()
                while status == 200 and (part := outer.parts.get()) is not None:
                    head = b"--frame\r\nContent-Type: image/jpeg\r\n"
                    head += b"Content-Length: %d\r\n" % len(part) if with_length else b""
                    try:
                        self.wfile.write(head + b"\r\n" + part + b"\r\n")
                    except OSError:
                        return

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)
        self._thread.start()
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/video"

    def send(self, image: Picture) -> None:
        ok, data = cv2.imencode(".jpg", image)
        assert ok
        self.parts.put(data.tobytes())

    def send_bytes(self, data: bytes) -> None:
        self.parts.put(data)

    def drop(self) -> None:
        self.parts.put(None)

    def close(self) -> None:
        self.parts.put(None)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
