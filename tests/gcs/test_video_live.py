from __future__ import annotations

import queue
import threading

import numpy as np
import pytest

from gcs.errors import VideoError
from gcs.video import live as live_module
from gcs.video.frame import Decoded, Decoder
from gcs.video.live import LiveSource


class HandFedDecoder:
    """Gives what the test puts in; `idle` is set whenever it waits for more, so that tests need no sleep."""

    fps = 30.0
    frame_count = None

    def __init__(self) -> None:
        self.feed: queue.Queue[Decoded | VideoError | None] = queue.Queue()
        self.idle = threading.Event()
        self.closed = threading.Event()

    def put(self, *values: int) -> None:
        """Feed uniform pictures of these grey values, and wait until all are taken."""
        self.idle.clear()
        for value in values:
            self.feed.put(Decoded(np.full((8, 8, 3), value, np.uint8)))
        assert self.idle.wait(5.0)

    def read(self) -> Decoded | None:
        if self.feed.empty():
            self.idle.set()
        item = self.feed.get()
        if isinstance(item, VideoError):
            raise item
        return item

    def close(self) -> None:
        self.closed.set()


def hand_fed(first: int = 1, **options: object) -> tuple[LiveSource, HandFedDecoder]:
    decoder = HandFedDecoder()
    decoder.feed.put(Decoded(np.full((8, 8, 3), first, np.uint8)))
    source = LiveSource("fed", lambda: decoder, **{"reconnect": False, **options})  # type: ignore[arg-type]
    assert decoder.idle.wait(5.0)
    return source, decoder


def test_the_newest_frame_wins_and_the_gap_shows_in_seq() -> None:
    source, decoder = hand_fed()
    first = source.read(1.0)
    assert first is not None
    assert (first.seq, int(first.image_bgr[0, 0, 0])) == (0, 1)
    decoder.put(10, 20, 30)
    newest = source.read(1.0)
    assert newest is not None
    assert (newest.seq, int(newest.image_bgr[0, 0, 0])) == (3, 30)
    assert source.read(0.0) is None  # each frame is given once
    assert not source.ended
    decoder.feed.put(None)
    source.close()
    assert decoder.closed.is_set()


def test_frames_are_stamped_on_arrival_less_the_glass_delay() -> None:
    times_s = iter([100.0, 100.5])
    source, decoder = hand_fed(glass_delay_s=0.2, clock=lambda: next(times_s))
    source.read(1.0)
    decoder.put(2)
    frame = source.read(1.0)
    assert frame is not None
    assert frame.t_arrival_s == 100.5
    assert frame.t_capture_s == pytest.approx(100.3)
    decoder.feed.put(None)
    source.close()


def test_the_time_of_decoding_is_told_apart() -> None:
    times_s = iter([100.0, 100.5])
    source, decoder = hand_fed(glass_delay_s=0.2, clock=lambda: next(times_s))
    source.read(1.0)
    decoder.feed.put(Decoded(np.full((8, 8, 3), 2, np.uint8), decode_s=0.03))
    frame = source.read(1.0)
    assert frame is not None
    assert (frame.t_arrival_s, frame.decode_s) == (pytest.approx(100.47), 0.03)
    assert frame.t_capture_s == pytest.approx(100.27)
    decoder.feed.put(None)
    source.close()


def test_without_reconnect_the_end_of_the_stream_wakes_the_reader() -> None:
    source, decoder = hand_fed()
    source.read(1.0)
    decoder.feed.put(VideoError("fed: gone"))
    assert source.read(5.0) is None
    assert source.ended
    assert source.problem == "fed: gone"
    source.close()


def test_a_frame_already_here_survives_the_end_of_its_stream() -> None:
    source, decoder = hand_fed()
    decoder.feed.put(None)
    assert decoder.closed.wait(5.0)
    assert source.read(5.0) is not None
    assert source.read(5.0) is None
    assert source.ended
    source.close()


def test_a_broken_stream_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = HandFedDecoder(), HandFedDecoder()
    first.feed.put(Decoded(np.full((8, 8, 3), 1, np.uint8)))
    openings = iter([first, VideoError("still away"), second])

    def opener() -> HandFedDecoder:
        item = next(openings)
        if isinstance(item, VideoError):
            raise item
        return item

    monkeypatch.setattr(live_module, "FIRST_BACKOFF_S", 0.01)
    source = LiveSource("fed", opener, reconnect=True)
    assert source.read(5.0) is not None
    first.feed.put(None)
    second.feed.put(Decoded(np.full((8, 8, 3), 9, np.uint8)))
    frame = source.read(10.0)
    assert frame is not None
    assert (frame.seq, int(frame.image_bgr[0, 0, 0])) == (1, 9)
    assert source.reconnects == 1
    assert first.closed.is_set()
    second.feed.put(None)
    source.close()


def test_pictures_of_another_size_are_left_out_and_told() -> None:
    source, decoder = hand_fed()
    source.read(1.0)
    assert source.trouble == ""
    decoder.idle.clear()
    decoder.feed.put(Decoded(np.zeros((16, 32, 3), np.uint8)))
    assert decoder.idle.wait(5.0)
    assert source.read(0.0) is None
    assert source.trouble == (
        "fed: the picture is now 32x16 px, but was 8x8: set the camera back, or start anew with this size"
    )
    decoder.put(7)  # somebody set the camera back
    frame = source.read(1.0)
    assert frame is not None
    assert (frame.seq, source.trouble) == (1, "")
    decoder.feed.put(None)
    source.close()


def test_what_is_wrong_is_told_while_it_lasts() -> None:
    now_s = [100.0]
    source, decoder = hand_fed(clock=lambda: now_s[0])
    assert source.trouble == ""
    now_s[0] += 3.0
    assert source.trouble == "fed: no picture for 3 s"
    decoder.idle.clear()
    decoder.feed.put(Decoded(np.full((8, 8, 3), 2, np.uint8), decode_s=0.8))
    assert decoder.idle.wait(5.0)
    assert source.trouble == "fed: decoding is 0.8 s behind: send a smaller picture, or fewer of them"
    decoder.put(3)
    assert source.trouble == ""
    decoder.feed.put(VideoError("fed: gone"))
    assert decoder.closed.wait(5.0)
    assert source.trouble == "fed: gone"
    source.close()
    assert source.trouble == ""


def test_a_stream_that_opens_but_gives_no_picture_is_tried_ever_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    decoders: list[HandFedDecoder] = []
    tried = threading.Event()

    def opener() -> HandFedDecoder:
        decoder = HandFedDecoder()
        decoder.feed.put(None if decoders else Decoded(np.zeros((8, 8, 3), np.uint8)))
        decoder.feed.put(None)
        decoders.append(decoder)
        return decoder

    def reopen(source: LiveSource, backoff_s: float) -> tuple[Decoder | None, float]:
        pauses.append(backoff_s)
        if len(pauses) == 5:
            tried.set()
        return original(source, backoff_s)

    original = LiveSource._reopen
    monkeypatch.setattr(LiveSource, "_reopen", reopen)
    monkeypatch.setattr(live_module, "FIRST_BACKOFF_S", 0.001)
    monkeypatch.setattr(live_module, "MAX_BACKOFF_S", 0.004)
    source = LiveSource("fed", opener)
    assert tried.wait(5.0)
    assert source.trouble == "fed: the stream has ended; trying again"
    assert pauses[:5] == [0.001, 0.002, 0.004, 0.004, 0.004]
    source.close()


def test_closing_does_not_wait_for_a_stream_that_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "CLOSE_WAIT_S", 0.05)
    source, decoder = hand_fed()
    source.read(1.0)
    source.close()
    assert source.ended
    assert source.trouble == ""
    decoder.feed.put(None)
    assert decoder.closed.wait(5.0)


def test_opened_but_without_a_frame() -> None:
    decoder = HandFedDecoder()
    decoder.feed.put(None)
    with pytest.raises(VideoError, match="no frame came"):
        LiveSource("fed", lambda: decoder)
    assert decoder.closed.is_set()
