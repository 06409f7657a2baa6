"""H.264 in RTP packets (RFC 6184, by FFmpeg's own packetiser), and the SDP that tells a receiver what they are."""

from __future__ import annotations

import base64
import secrets
from typing import Any, Final

from gcs.video_out.encoder import TIME_BASE, Coded

PAYLOAD_TYPE: Final = 96
_PACKET_BYTES: Final = 1200  # through any tunnel


class Packetizer:
    """One RTP stream; packets of a picture in their order, the last one with the marker bit."""

    def __init__(self, size: tuple[int, int]) -> None:
        import av  # an optional package: the module must import without it

        self._packets: list[bytes] = []
        options = {
            "packetsize": str(_PACKET_BYTES),
            "payload_type": str(PAYLOAD_TYPE),
            "ssrc": str(1 + secrets.randbelow(2**31 - 2)),
            "rtpflags": "skip_rtcp",
        }
        self._av: Any = av
        self._muxer: Any = av.open(self, "w", format="rtp", options=options)
        width, height = size
        self._stream: Any = self._muxer.add_mux_stream("h264", width=width, height=height, time_base=TIME_BASE)

    def write(self, packet: bytes) -> int:
        """FFmpeg hands over one packet at a time."""
        self._packets.append(bytes(packet))
        return len(packet)

    def packets(self, coded: Coded) -> list[bytes]:
        """The picture in packets; ticks must grow from one to the next."""
        packet = self._av.Packet(coded.data)
        packet.pts = packet.dts = coded.ticks
        packet.time_base, packet.stream, packet.is_keyframe = TIME_BASE, self._stream, coded.is_key
        self._muxer.mux(packet)
        packets, self._packets = self._packets, []
        return packets


def sdp(parameter_sets: tuple[bytes, bytes], host: str = "0.0.0.0", port: int = 0, control: str = "") -> str:
    """Session description (RFC 8866): port 0 and a control address for RTSP, where it is sent to for plain RTP."""
    sps, _ = parameter_sets
    sets = ",".join(base64.b64encode(each).decode() for each in parameter_sets)
    family = "IP6" if ":" in host else "IP4"
    lines = [
        "v=0",
        f"o=- 0 0 IN {family} {host}",
        "s=climrt-gcs",
        f"c=IN {family} {host}",
        "t=0 0",
        f"m=video {port} RTP/AVP {PAYLOAD_TYPE}",
        f"a=rtpmap:{PAYLOAD_TYPE} H264/90000",
        f"a=fmtp:{PAYLOAD_TYPE} packetization-mode=1;profile-level-id={sps[1:4].hex()};sprop-parameter-sets={sets}",
        "a=recvonly" if not control else f"a=control:{control}",
    ]
    return "\r\n".join(lines) + "\r\n"
