"""Browsers that take the station's pictures by WebRTC: all of them the same encoded ones."""

from __future__ import annotations

import asyncio
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from gcs.errors import GcsError
from gcs.operator.station import Station
from gcs.video_out.live import LiveStream
from gcs.video_out.own_thread import on_own_thread

if TYPE_CHECKING:
    from gcs.video_out.peer import Peer

_MOST_PEERS: Final = 8
_MOST_OFFER_BYTES: Final = 64 * 1024
_BITRATE_KBPS: Final = 2500


class Peers:
    """Of one station; needs aiortc. Pictures are raw: browsers draw box and state, from the frame's number."""

    def __init__(self, station: Station) -> None:
        self._station = station
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
            module = await load()
            if self._stream is None:
                self._stream = LiveStream(self._station, _BITRATE_KBPS, annotated=False)
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


async def load() -> Any:
    """The module of one peer; with it comes aiortc, which takes half a second."""
    return await on_own_thread(partial(import_module, "gcs.video_out.peer"))
