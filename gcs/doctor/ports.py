"""Whether the addresses we listen on are free, and a serial port may be opened."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import closing

from gcs.doctor.check import Question, Result, Say, fail, ok, skip
from gcs.errors import WireError
from gcs.transport import Endpoint, Kind, parse_url


def page_port(question: Question, _say: Say) -> Iterator[Result]:
    """Of the operator's page."""
    page = question.config.page
    if not page.enabled:
        yield skip("port of the page", "the page is switched off")
        return
    fix = "is another `gcs run` running? end it, or take another: --port N, page.port"
    yield _bind("port of the page", socket.SOCK_STREAM, page.host, page.port, fix)


def rtsp_port(question: Question, _say: Say) -> Iterator[Result]:
    """Of the video that goes out."""
    video = question.config.video_out
    if video.rtsp_port is not None:
        fix = "end what serves RTSP there, or take another: --rtsp PORT, video_out.rtsp_port"
        yield _bind("port of RTSP", socket.SOCK_STREAM, video.host, video.rtsp_port, fix)


def camera_port(question: Question, _say: Say) -> Iterator[Result]:
    """Of the MAVLink camera."""
    url = question.config.mavlink_camera.url
    if url is not None:
        yield from _link("port of the camera", url, "take another: --qgc URL, mavlink_camera.url")


def vehicle_port(question: Question, _say: Say) -> Iterator[Result]:
    """Of the vehicle's link."""
    if question.vehicle is None:
        yield skip("port of the link", "not looked at: give --vehicle URL, --profile or --config")
        return
    fix = "end the other station (QGroundControl, MAVProxy, another `gcs`), or listen elsewhere: --vehicle URL"
    yield from _link("port of the link", question.vehicle, fix)


def _link(name: str, url: str, fix: str) -> Iterator[Result]:
    try:
        endpoint = parse_url(url)
    except WireError as error:
        yield fail(name, str(error), "give udpin://HOST:PORT, udpout://, tcpout:// or serial:///dev/NAME:BAUD")
        return
    match endpoint.kind:
        case Kind.SERIAL:
            yield _serial(name, endpoint)
        case Kind.UDP_IN:
            yield _bind(name, socket.SOCK_DGRAM, endpoint.host, endpoint.port, fix)
        case Kind.TCP_IN:
            yield _bind(name, socket.SOCK_STREAM, endpoint.host, endpoint.port, fix)
        case Kind.UDP_OUT | Kind.TCP_OUT:
            yield ok(name, f"{endpoint}: nothing is listened on")


def _bind(name: str, kind: socket.SocketKind, host: str, port: int, fix: str) -> Result:
    """Listen there for a moment."""
    where = f"{host}:{port}"
    if port == 0:
        return ok(name, f"{host}, any free one")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
        with closing(socket.socket(family, kind)) as probe:
            if kind == socket.SOCK_STREAM:  # as a server does, or the last one's closed connections are in the way
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return fail(name, f"{where}: {(error.strerror or str(error)).lower()}", fix)
    return ok(name, f"{where} is free")


def _serial(name: str, endpoint: Endpoint) -> Result:
    device = endpoint.device
    if not os.path.exists(device):
        known = [entry.path for entry in os.scandir("/dev") if entry.name.startswith(("ttyUSB", "ttyACM"))]
        there = f"there are {', '.join(sorted(known))}" if known else "no radio or autopilot is plugged in"
        return fail(name, f"{device}: no such device; {there}", "plug it in, or name the right one: --vehicle URL")
    if not os.access(device, os.R_OK | os.W_OK):
        return fail(name, f"{device}: permission denied", "sudo usermod -aG dialout $USER, then log in again")
    return ok(name, f"{endpoint} may be opened")
