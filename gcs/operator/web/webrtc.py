"""What the page asks of WebRTC: an answer to a browser's offer, and to end them all."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from gcs.errors import GcsError

if TYPE_CHECKING:
    from gcs.operator.station import Station
    from gcs.video_out.peers import Peers

_PEERS: Final[list[Peers]] = []  # one for each station that was asked for


def is_installed() -> bool:
    """Whether `pip install climrt-gcs[webrtc]` was done."""
    return find_spec("aiortc") is not None and find_spec("av") is not None


async def prepare() -> None:
    """Load what it needs, which stops the event loop for some 0.05 s: better before a flight than in it."""
    if is_installed():
        from gcs.video_out.peers import load

        await load()


async def answer(station: Station, offer_sdp: str) -> str:
    """The SDP answer; GcsError with the reason where there is none."""
    if not is_installed():
        raise GcsError("WebRTC needs aiortc: pip install climrt-gcs[webrtc]")
    from gcs.video_out.peers import Peers  # brings OpenCV: the page starts without

    peers = next((each for each in _PEERS if each.station is station), None)
    if peers is None:
        peers = Peers(station)
        _PEERS.append(peers)
    return await peers.answer(offer_sdp)


async def close_all() -> None:
    """End every connection, of every station."""
    while _PEERS:
        await _PEERS.pop().close_all()
