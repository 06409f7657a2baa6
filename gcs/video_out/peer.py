"""One browser by WebRTC. Imports aiortc, an optional package: only `gcs.video_out.peers` imports this."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import av
from aiortc import (
    MediaStreamTrack,
    RTCConfiguration,
    RTCPeerConnection,
    RTCRtpSender,
    RTCSessionDescription,
)
from aiortc.mediastreams import MediaStreamError

from gcs.errors import GcsError, one_line
from gcs.video_out.encoder import TIME_BASE, Coded
from gcs.video_out.live import LiveStream

_CONNECT_S: Final = 15.0
_MOST_QUEUED: Final = 15
_TOLD: Final = 8  # frame numbers repeated in each message, as messages may get lost
_MOST_UNSENT_BYTES: Final = 16 * 1024


class Peer:
    """Sends H.264 that is encoded already, and says which RTP time is which frame.

    The data channel `frames`, which the browser opens, carries `[[rtp timestamp, frame number], ...]`.
    """

    def __init__(self, stream: LiveStream, gone: Callable[[Peer], None]) -> None:
        """gone: told once, when it has ended."""
        self._gone = gone
        # No STUN: there may be no internet, and everybody is on the same machine or network.
        self._connection: Any = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connection.on("connectionstatechange", self._changed)
        self._connection.on("datachannel", self._opened)
        self._channel: Any = None
        self._track = _Track(stream, self._sending)
        self._told: deque[tuple[int, int]] = deque(maxlen=_TOLD)
        self._sent: Coded | None = None
        self._ended = False
        self._closing: asyncio.Task[None] | None = None  # kept, lest it be collected before its end

    async def answer(self, offer_sdp: str) -> str:
        """Take the offer; GcsError where it cannot be answered, and then this has ended."""
        connection = self._connection
        asyncio.get_running_loop().call_later(_CONNECT_S, self._check)
        try:
            transceiver = connection.addTransceiver(self._track, direction="sendonly")
            codecs = RTCRtpSender.getCapabilities("video").codecs
            transceiver.setCodecPreferences([each for each in codecs if each.mimeType == "video/H264"])
            self._sender: Any = transceiver.sender
            # A receiver that lost a picture asks for a key frame; aiortc would ask the encoder it does not have here.
            self._sender._send_keyframe = self._track.stream.want_key
            await connection.setRemoteDescription(RTCSessionDescription(_without_hidden(offer_sdp), "offer"))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as error:  # noqa: BLE001 - a stranger's text has been through aiortc's parser
            await self.close()
            raise GcsError(
                f"the browser's offer cannot be answered: {one_line(error) or type(error).__name__}"
            ) from None
        return str(connection.localDescription.sdp)

    async def close(self) -> None:
        """End it."""
        self._ended = True
        self._gone(self)
        self._track.stop()
        await self._connection.close()

    def _changed(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            self._end()

    def _check(self) -> None:
        if self._connection.connectionState != "connected":
            self._end()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._closing = asyncio.create_task(self.close(), name="webrtc peer ends")

    # -- which picture is which ---------------------------------------------------------------------------

    def _opened(self, channel: Any) -> None:
        self._channel = channel

    def _sending(self, coded: Coded) -> None:
        """This picture is sent next; the one before has been.

        RTP times start anywhere (RFC 3550), and aiortc tells nobody where: it is the difference between the
        time of the last packet sent and the time we gave it.
        """
        before, self._sent = self._sent, coded
        if before is None:
            return
        start = self._sender._RTCRtpSender__rtp_timestamp - before.ticks
        if not self._told:
            self._told.append(((start + before.ticks) % 2**32, before.seq))
        self._told.append(((start + coded.ticks) % 2**32, coded.seq))
        channel = self._channel
        if channel is not None and channel.readyState == "open" and channel.bufferedAmount < _MOST_UNSENT_BYTES:
            channel.send(json.dumps(list(self._told)))


def _without_hidden(offer_sdp: str) -> str:
    """Without the candidates whose address the browser hides behind a name of multicast DNS.

    Each is looked up for a second, most often in vain; the browser finds us at our addresses instead.
    """
    lines = offer_sdp.splitlines(keepends=True)
    return "".join(line for line in lines if not (line.startswith("a=candidate:") and ".local " in line))


class _Track(MediaStreamTrack):  # type: ignore[misc]
    """Gives aiortc what is encoded already, so that it encodes nothing itself, which it would on shared threads."""

    kind = "video"

    def __init__(self, stream: LiveStream, sending: Callable[[Coded], None]) -> None:
        super().__init__()
        self.stream = stream
        self._sending = sending
        self._queue: deque[Coded] = deque()
        self._filled = asyncio.Event()
        self._end_taking: Callable[[], None] | None = None
        self._needs_key = True

    async def recv(self) -> Any:
        """The next picture; asked for only once the connection stands."""
        if self.readyState != "live":
            raise MediaStreamError
        if self._end_taking is None:
            self._end_taking = self.stream.take(self._put)
        while not self._queue:
            self._filled.clear()
            await self._filled.wait()
        coded = self._queue.popleft()
        self._sending(coded)
        packet = av.Packet(coded.data)
        packet.pts, packet.time_base = coded.ticks, TIME_BASE
        return packet

    def stop(self) -> None:
        """No more pictures."""
        super().stop()
        if self._end_taking is not None:
            self._end_taking()

    def _put(self, coded: Coded) -> None:
        if len(self._queue) >= _MOST_QUEUED:
            self._queue.clear()
            self._needs_key = True
            self.stream.want_key()
        if self._needs_key and not coded.is_key:
            return
        self._needs_key = False
        self._queue.append(coded)
        self._filled.set()
