"""A radio between camera and station: it loses datagrams, swaps them and damages bits."""

from __future__ import annotations

import random
import socket
import threading

from tests.gcs.stream_sender import free_port


class BadRelay:
    """What comes to `port` goes on to to_port; once `is_bad`, but for the shares (0 to 1) that are lost, late by one,
    or damaged.
    """

    def __init__(self, to_port: int, *, lost: float = 0.0, swapped: float = 0.0, damaged: float = 0.0) -> None:
        self.port = free_port()
        self.is_bad = False
        self.harmed = 0
        self._shares = lost, swapped, damaged
        self._to = ("127.0.0.1", to_port)
        self._random = random.Random(7)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self.port))
        self._socket.settimeout(0.1)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> BadRelay:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self._socket.close()

    def _run(self) -> None:
        held = b""
        while not self._stop.is_set():
            try:
                data = self._socket.recv(65536)
            except TimeoutError:
                continue
            lost, swapped, damaged = (self.is_bad and self._random.random() < share for share in self._shares)
            self.harmed += lost or swapped or damaged
            if damaged:
                changed = bytearray(data)
                changed[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
                data = bytes(changed)
            if lost:
                continue
            if swapped and not held:
                held = data
                continue
            self._socket.sendto(data, self._to)
            if held:
                self._socket.sendto(held, self._to)
                held = b""
