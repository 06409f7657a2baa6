"""What the page asks of WebRTC: an answer to a browser's offer, and to end them all."""

from __future__ import annotations

from typing import Final

from gcs.operator.station import Station
from gcs.video_out.peers import Peers, is_installed

__all__ = ["answer", "close_all", "is_installed"]

_PEERS: Final[dict[int, tuple[Station, Peers]]] = {}


async def answer(station: Station, offer_sdp: str) -> str:
    """The SDP answer; GcsError with the reason where there is none."""
    _, peers = _PEERS.setdefault(id(station), (station, Peers(station)))
    return await peers.answer(offer_sdp)


async def close_all() -> None:
    """End every connection, of every station."""
    while _PEERS:
        _, (_, peers) = _PEERS.popitem()
        await peers.close_all()
