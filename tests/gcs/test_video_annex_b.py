"""Parameter sets as files and RTMP bring them, taken from what real encoders write; whole and cut off."""

from __future__ import annotations

import io

import pytest

from gcs.video.annex_b import is_annex_b, parameter_sets
from gcs.video.decoding import PacketDecoder
from gcs.video.pyav import is_installed
from gcs.video.tap import Coding, Library
from tests.gcs import clips

pytestmark = pytest.mark.skipif(not is_installed(), reason="encoding needs PyAV")
KINDS = [("libx264", "h264", {7, 8}), ("libx265", "hevc", {32, 33, 34})]


def recorded(encoder: str) -> tuple[bytes, list[bytes]]:
    """What an mp4 says of its stream, and its packets as Annex B without parameter sets."""
    import av
    from av.bitstream import BitStreamFilterContext

    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        options = {"x265-params": "log-level=none"} if encoder == "libx265" else {}
        stream = container.add_stream(encoder, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = *clips.SIZE, "yuv420p"
        for index in range(10):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(clips.picture(index), format="bgr24")))
        container.mux(stream.encode(None))
    file.seek(0)
    with av.open(file) as container:
        stream = container.streams.video[0]
        name = stream.codec_context.name
        units = BitStreamFilterContext(f"{name}_mp4toannexb,filter_units=remove_types=7-8|32-34", stream)
        packets = [bytes(each) for packet in container.demux(stream) if packet.size for each in units.filter(packet)]
        return bytes(stream.codec_context.extradata), packets


def kinds_of(data: bytes, codec: str) -> list[int]:
    """The types of the NAL units."""
    units = [unit for unit in data.split(b"\0\0\0\1") if unit]
    return [unit[0] & 0x1F if codec == "h264" else unit[0] >> 1 & 0x3F for unit in units]


@pytest.mark.parametrize(("encoder", "codec", "kinds"), KINDS)
def test_a_decoder_begins_with_them(encoder: str, codec: str, kinds: set[int]) -> None:
    record, packets = recorded(encoder)
    found = parameter_sets(codec, record)
    assert not is_annex_b(codec, record)
    assert is_annex_b(codec, found)
    assert kinds <= set(kinds_of(found, codec))
    decoder = PacketDecoder(Coding(codec, Library.FFMPEG, found))
    frames = [frame for data in [*packets, b""] for frame in decoder.decode(data, is_key=False, skips=False)]
    assert len(frames) == 10


@pytest.mark.parametrize(("encoder", "codec", "kinds"), KINDS)
def test_a_damaged_record_gives_what_it_has(encoder: str, codec: str, kinds: set[int]) -> None:
    record, _ = recorded(encoder)
    whole = parameter_sets(codec, record)
    for end in range(len(record)):
        assert whole.startswith(parameter_sets(codec, record[:end]))
    parameter_sets(codec, b"\xff" * 40)


def test_other_codecs_have_none() -> None:
    assert is_annex_b("mjpeg", b"\1\2\3")
    assert is_annex_b("h264", b"")
    assert is_annex_b("h264", b"\0\0\1\x67")
