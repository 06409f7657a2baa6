"""What a station needs round it to fly: a mocked vehicle on a real UDP socket, and a camera that sends 30 pictures a
second over the network. The pictures are made and coded before, so that sending them costs next to nothing."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import socket
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from gcs.benchmark.coded import FPS, coded, jpeg
from gcs.benchmark.films import Image
from gcs.video_out.encoder import TICKS_HZ
from gcs.video_out.rtp import Packetizer
from sitl_mocks.mjpeg import MjpegServer
from sitl_mocks.vehicle import PREPARED, MockVehicle, Personality
from sitl_mocks.vehicle.server import run_udp

_HEIGHT_M: Final = 9.0
_PICTURES: Final = 120  # then from the first again, without a jump
_PAN_FRAC: Final = 0.05  # of the width: how far the ground moves to and fro
_WOBBLE_FRAC: Final = 0.01
TARGET_FRAC: Final = (0.06, 0.08)  # of the picture's width and height


@dataclass
class Vehicle:
    """Flies until the block ends. sent_s: when each setpoint reached it (monotonic)."""

    url: str
    setpoints_s: list[float] = field(default_factory=list)

    def observe(self, datagram: bytes, now_s: float) -> None:
        """See `run_udp`."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        for message in parser.parse_buffer(bytearray(datagram)) or ():
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints_s.append(now_s)


@contextlib.asynccontextmanager
async def vehicle() -> AsyncIterator[Vehicle]:
    """Armed and hovering, with the parameters of a careful owner."""
    port = free_port()
    flown = Vehicle(f"udpin://127.0.0.1:{port}")
    mock = MockVehicle(Personality.PX4, airborne_m=_HEIGHT_M, parameters=PREPARED[Personality.PX4])
    server = asyncio.create_task(run_udp(mock, ("127.0.0.1", port), observe=flown.observe))
    try:
        yield flown
    finally:
        await _ended(server)


@contextlib.asynccontextmanager
async def mjpeg_camera(size: tuple[int, int]) -> AsyncIterator[str]:
    """Its address: JPEG over HTTP."""
    parts = [jpeg(image) for image in pictures(size)]
    server = MjpegServer()
    await server.start()
    sending = asyncio.create_task(_paced(lambda number: server.publish(parts[number % len(parts)])))
    try:
        yield server.url
    finally:
        await _ended(sending)
        await server.close()


@contextlib.asynccontextmanager
async def h264_camera(size: tuple[int, int]) -> AsyncIterator[str]:
    """Its address: H.264 over RTP, a key frame each second."""
    parts = coded(pictures(size), key_every=FPS)
    packetizer, port = Packetizer(size), free_port()

    def send(number: int) -> None:
        part = replace(parts[number % len(parts)], seq=number, ticks=number * TICKS_HZ // FPS)
        for packet in packetizer.packets(part):
            with contextlib.suppress(OSError):  # nobody listens yet
                out.sendto(packet, ("127.0.0.1", port))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        sending = asyncio.create_task(_paced(send))
        try:
            yield f"rtp://127.0.0.1:{port}"
        finally:
            await _ended(sending)


CAMERAS: Final = {"Motion JPEG": mjpeg_camera, "H.264": h264_camera}


async def _paced(send: Callable[[int], None]) -> None:
    """Each picture at its time; a camera makes up for nothing."""
    due_s = time.monotonic()
    for number in itertools.count():
        send(number)
        due_s = max(due_s + 1 / FPS, time.monotonic())
        await asyncio.sleep(due_s - time.monotonic())


async def _ended(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def free_port() -> int:
    """Of UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def pictures(size: tuple[int, int], count: int = _PICTURES) -> list[Image]:
    """A target that stays near the middle before ground that moves to and fro; the last joins the first."""
    width, height = size
    random, reach = np.random.default_rng(1), math.ceil(_PAN_FRAC * width)
    small = random.integers(40, 215, (height // 8, (width + 2 * reach) // 8 + 1, 3), np.uint8)
    ground = cv2.resize(small, (width + 2 * reach, height), interpolation=cv2.INTER_CUBIC)
    target = _target(round(width * TARGET_FRAC[0]), round(height * TARGET_FRAC[1]))
    found = []
    for number in range(count):
        phase = 2 * math.pi * number / count
        left = reach + round(reach * math.sin(phase))
        image = np.ascontiguousarray(ground[:, left : left + width])
        x = (width - target.shape[1]) // 2 + round(_WOBBLE_FRAC * width * math.sin(3 * phase))
        y = (height - target.shape[0]) // 2
        image[y : y + target.shape[0], x : x + target.shape[1]] = target
        found.append(np.asarray(image, np.uint8))
    return found


def _target(width: int, height: int) -> Image:
    """A thing with edges and a colour of its own."""
    image = np.full((height, width, 3), (20, 30, 220), np.uint8)
    cv2.rectangle(image, (width // 5, height // 5), (width * 4 // 5, height // 2), (230, 230, 230), -1)
    cv2.circle(image, (width // 2, height * 3 // 4), max(2, height // 8), (10, 10, 10), -1)
    return image
