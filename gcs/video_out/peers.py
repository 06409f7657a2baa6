"""Browsers that take the station's pictures by WebRTC: all of them the same encoded ones."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from gcs.errors import GcsError
from gcs.operator.station import Station
from gcs.video_out.live import LiveStream

if TYPE_CHECKING:
    from gcs.video_out.peer import Peer

_MOST_PEERS: Final = 8
_MOST_OFFER_BYTES: Final = 64 * 1024
_BITRATE_KBPS: Final = 2500


class Peers:
    """Of one station; needs aiortc. Pictures are raw: browsers draw box and state, from the frame's number."""

    def __init__(self, station: Station) -> None:
        self.station = station
        self._stream: LiveStream | None = None
        self._peers: set[Peer] = set()
        self._one_by_one = asyncio.Lock()

    @property
    def count(self) -> int:
        """How many are connected, or about to be."""
        return len(self._peers)

    async def answer(self, offer_sdp: str) -> str:
        """The answer to a browser's offer; GcsError with the reason where it cannot be served."""
        if len(offer_sdp) > _MOST_OFFER_BYTES:
            raise GcsError("an offer of more than 64 kB")
        async with self._one_by_one:
            if len(self._peers) >= _MOST_PEERS:
                raise GcsError(f"{_MOST_PEERS} browsers take WebRTC already")
            module = await _loaded()
            if self._stream is None:
                self._stream = LiveStream(self.station, _BITRATE_KBPS, annotated=False)
            peer = module.Peer(self._stream, self._peers.discard)
            self._peers.add(peer)
            return str(await peer.answer(offer_sdp))

    async def close_all(self) -> None:
        """End them all."""
        for peer in tuple(self._peers):
            await peer.close()
        if self._stream is not None:
            await self._stream.close()
            self._stream = None


async def _loaded() -> Any:
    """aiortc takes half a second to load: not on the event loop, nor on the default threads."""
    with ThreadPoolExecutor(1) as own:
        return await asyncio.get_running_loop().run_in_executor(own, import_module, "gcs.video_out.peer")
