"""Video for other programs, as configured: an RTSP server, and RTP sent to one address."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from gcs.errors import WireError
from gcs.operator.addresses import reachable_url
from gcs.operator.config import VideoOutConfig
from gcs.operator.station import Station
from gcs.video_out.encoder import Coded, require_av
from gcs.video_out.live import LiveStream
from gcs.video_out.rtp import Packetizer, sdp
from gcs.video_out.rtsp import PATH, TRACK
from gcs.video_out.rtsp_server import RtspServer


class VideoOut:
    """Encodes while somebody takes it: a client of RTSP, or the one address that RTP always goes to."""

    def __init__(self, config: VideoOutConfig, station: Station) -> None:
        """GcsError, with what to install, where PyAV is missing."""
        require_av()
        self.encoded = 0  # pictures so far
        self._config, self._station = config, station
        self._parameter_sets = b"", b""
        self._stream: LiveStream | None = None
        self._server: RtspServer | None = None
        self._rtp: Any = None
        self._packetizer: Packetizer | None = None
        self._end_taking: Callable[[], None] | None = None
        self._viewers = 0

    async def open(self) -> None:
        """Listen and send from now on; WireError where a port is taken or a host unknown."""
        config = self._config
        self._stream = LiveStream(self._station, config.bitrate_kbps, annotated=config.annotated)
        try:
            self._parameter_sets = await self._stream.parameter_sets()
            self._packetizer = Packetizer(self._station.size)
            if config.rtsp_port is not None:
                self._server = RtspServer(lambda: sdp(self._parameter_sets, control=TRACK), self._changed)
                await self._server.open(config.host, config.rtsp_port)
            if config.rtp is not None:
                self._rtp = await _datagrams_to(*_host_port(config.rtp))
        except BaseException:
            await self.close()
            raise
        self._changed()

    @property
    def rtsp_url(self) -> str | None:
        """Where the stream is to be had, as other machines know it; None: it is not served."""
        if self._server is None:
            return None
        return reachable_url("rtsp", self._config.host, self._server.port, PATH)

    def sdp(self) -> str | None:
        """What a receiver of the RTP packets must be told; None: none are sent."""
        if self._config.rtp is None:
            return None
        return sdp(self._parameter_sets, *_host_port(self._config.rtp))

    @property
    def problem(self) -> str | None:
        """Why no video goes out although it should, in one line."""
        return self._stream.problem if self._stream is not None else None

    @property
    def viewers(self) -> int:
        """How many take it now; the fixed address is one."""
        return (self._server.players if self._server is not None else 0) + (self._rtp is not None)

    async def close(self) -> None:
        """End it all."""
        if self._server is not None:
            await self._server.close()
        if self._rtp is not None:
            self._rtp.close()
        if self._stream is not None:
            await self._stream.close()

    def _changed(self) -> None:
        """Encode while somebody takes it; whoever is new gets a key frame."""
        assert self._stream is not None
        viewers = self.viewers
        if viewers > self._viewers:
            self._stream.want_key()
        self._viewers = viewers
        if viewers and self._end_taking is None:
            self._end_taking = self._stream.take(self._send)
        elif not viewers and self._end_taking is not None:
            self._end_taking()
            self._end_taking = None

    def _send(self, coded: Coded) -> None:
        assert self._packetizer is not None
        self.encoded += 1
        packets = self._packetizer.packets(coded)
        if self._server is not None:
            self._server.send(packets, coded.is_key)
        for packet in packets if self._rtp is not None else ():
            if self._rtp.get_write_buffer_size() == 0:  # lost, rather than late
                self._rtp.sendto(packet)


def _host_port(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host.strip("[]"), int(port)


async def _datagrams_to(host: str, port: int) -> Any:
    loop = asyncio.get_running_loop()
    try:
        transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=(host, port))
    except OSError as error:
        raise WireError(f"RTP to {host}:{port}: {(error.strerror or str(error)).lower()}") from None
    return transport
