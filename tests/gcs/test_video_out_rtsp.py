"""RTSP without sockets: what a client says, and what is answered."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.video_out.rtsp import TIMEOUT_S, HostileError, Interleaved, RtspConnection, Udp

URL = "rtsp://127.0.0.1:8554/live"
SDP = "v=0\r\ns=test\r\n"


def connection(udp_ports: tuple[int, int] | None = (6000, 6001)) -> RtspConnection:
    return RtspConnection("abc", lambda: SDP, udp_ports, 0.0)


def request(method: str, url: str = URL, *headers: str, sequence: int = 7) -> bytes:
    return "\r\n".join([f"{method} {url} RTSP/1.0", f"CSeq: {sequence}", *headers, "", ""]).encode()


def ask(rtsp: RtspConnection, method: str, url: str = URL, *headers: str) -> tuple[int, str]:
    """(status, the whole answer)."""
    answer = rtsp.receive(request(method, url, *headers), 1.0).decode()
    match = re.match(r"RTSP/1\.0 (\d{3}) ", answer)
    assert match is not None
    assert "\r\nCSeq: 7\r\n" in answer
    return int(match[1]), answer


def set_up(rtsp: RtspConnection, transport: str = "RTP/AVP/TCP;unicast;interleaved=0-1") -> tuple[int, str]:
    return ask(rtsp, "SETUP", f"{URL}/track0", f"Transport: {transport}")


def test_a_client_asks_sets_up_plays_pauses_and_leaves():
    rtsp = connection()
    assert "Public: OPTIONS, DESCRIBE" in ask(rtsp, "OPTIONS", "*")[1]
    assert ask(rtsp, "DESCRIBE")[1].endswith(f"Content-Length: {len(SDP)}\r\n\r\n{SDP}")
    status, answer = set_up(rtsp)
    assert (status, rtsp.transport, rtsp.playing) == (200, Interleaved(0), False)
    assert "Session: abc;timeout=60\r\nTransport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n" in answer
    assert ask(rtsp, "PLAY", URL, "Session: abc")[0] == 200
    assert rtsp.playing
    assert ask(rtsp, "GET_PARAMETER", URL, "Session: abc;timeout=60")[0] == 200
    assert ask(rtsp, "PAUSE")[0] == 200
    assert not rtsp.playing
    ask(rtsp, "PLAY")
    assert ask(rtsp, "TEARDOWN")[0] == 200
    assert rtsp.ended
    assert not rtsp.playing


def test_udp_goes_to_the_ports_asked_for_and_to_no_address_but_the_clients_own():
    rtsp = connection()
    status, answer = set_up(rtsp, "RTP/AVP;unicast;destination=10.9.9.9;client_port=5000-5001")
    assert (status, rtsp.transport) == (200, Udp(5000, 5001))
    assert "Transport: RTP/AVP;unicast;client_port=5000-5001;server_port=6000-6001\r\n" in answer


def test_the_first_transport_that_can_be_is_taken():
    rtsp = connection(udp_ports=None)
    assert set_up(rtsp, "RTP/AVP;unicast;client_port=5000-5001,RTP/AVP/TCP;unicast;interleaved=4-5")[0] == 200
    assert rtsp.transport == Interleaved(4)


@pytest.mark.parametrize(
    "transport",
    ["", "RTP/AVP;multicast", "RTP/AVP;unicast", "RTP/AVP;unicast;client_port=22-23", "RTP/AVP;client_port=70000-70001",
     "RTP/SAVP;unicast;client_port=5000-5001"],
)  # fmt: skip
def test_transports_that_cannot_be_are_refused(transport):
    rtsp = connection()
    assert set_up(rtsp, transport)[0] == 461
    assert rtsp.transport is None


def test_what_is_out_of_place_is_refused_with_its_own_code():
    rtsp = connection()
    assert ask(rtsp, "PLAY")[0] == 455  # nothing is set up
    assert ask(rtsp, "DESCRIBE", "rtsp://127.0.0.1/other")[0] == 404
    assert ask(rtsp, "DESCRIBE", "rtsp://[127.0.0.1/live")[0] == 404  # no address at all
    assert ask(rtsp, "ANNOUNCE")[0] == 405
    assert ask(rtsp, "PLAY", URL, "Session: zzz")[0] == 454
    assert b"505" in rtsp.receive(request("OPTIONS").replace(b"RTSP/1.0", b"RTSP/2.0"), 1.0)
    set_up(rtsp)
    ask(rtsp, "PLAY")
    assert set_up(rtsp)[0] == 455  # while it plays
    assert not rtsp.ended


def test_it_does_not_matter_how_the_bytes_are_cut():
    said = request("OPTIONS", sequence=1) + b"$\x01\x00\x05hello" + request("DESCRIBE", URL, "Content-Length: 4")
    said += b"body\r\n" + request("SETUP", URL, "Transport: RTP/AVP/TCP", sequence=3)
    whole = connection().receive(said, 1.0)
    assert whole.count(b"RTSP/1.0 200 OK") == 3
    rtsp = connection()
    assert b"".join(rtsp.receive(said[i : i + 1], 1.0) for i in range(len(said))) == whole


def test_silence_is_noticed_and_any_word_breaks_it():
    rtsp = connection()
    assert not rtsp.is_silent(TIMEOUT_S)
    assert rtsp.is_silent(TIMEOUT_S + 1)
    rtsp.receive(b"$\x01\x00\x00", TIMEOUT_S)
    assert not rtsp.is_silent(TIMEOUT_S + 1)


@pytest.mark.parametrize(
    "said",
    [b"A" * 5000, request("OPTIONS", URL, "Content-Length: 99999"), request("OPTIONS", URL, "Content-Length: -1"),
     request("OPTIONS") * 51, b"$\x01\x00\x00" * 51],
    ids=["no end", "long body", "no length", "many requests", "many packets"],
)  # fmt: skip
def test_too_much_ends_it(said):
    with pytest.raises(HostileError):
        connection().receive(said, 1.0)


@pytest.mark.parametrize("said", [b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\r\n\r\n", b"OPTIONS * RTSP/1.0\r\n\r\n"])
def test_what_is_no_rtsp_is_answered_once_and_ended(said):
    rtsp = connection()
    assert rtsp.receive(said * 2, 1.0) == b"RTSP/1.0 400 Bad Request\r\nCSeq: 0\r\n\r\n"
    assert rtsp.ended


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.one_of(st.binary(max_size=60), st.sampled_from([request("SETUP"), request("PLAY"), b"\r\n\r\n", b"$"])))
)
def test_no_bytes_do_anything_else(chunks):
    rtsp = connection()
    try:
        for chunk in chunks:
            rtsp.receive(chunk, 1.0)
    except HostileError:
        pass
    assert not (rtsp.playing and rtsp.transport is None)
