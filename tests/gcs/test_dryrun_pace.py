"""A recorded video on a clock of its own: pace, skipping, standing still at both ends, again from the start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.clock import FakeClock
from gcs.dryrun.pace import FilmFrame, PacedSource, Place
from gcs.errors import VideoError
from gcs.video import open_source
from tests.gcs.clips import write_clip


def paced(tmp_path: Path, frames: int = 6, limit_s: float | None = None) -> tuple[PacedSource, FakeClock]:
    clip = write_clip(tmp_path / "a.mp4", frames=frames)  # 20 a second
    clock = FakeClock(50.0)
    return PacedSource(lambda: open_source(str(clip)), clock, limit_s), clock


def read(source: PacedSource) -> FilmFrame | None:
    frame = source.read(0.0)
    assert frame is None or isinstance(frame, FilmFrame)
    return frame


def must(source: PacedSource) -> FilmFrame:
    frame = read(source)
    assert frame is not None
    return frame


def test_it_stands_at_the_first_picture_and_gives_it_again_and_again(tmp_path: Path) -> None:
    source, clock = paced(tmp_path)
    first = must(source)
    assert (first.index, first.place, first.t_arrival_s) == (0, Place.START, 50.0)
    assert read(source) is None
    clock.advance(0.3)
    again = must(source)
    assert (again.index, again.place, again.t_arrival_s) == (0, Place.START, 50.3)
    assert again.seq == first.seq + 1
    assert not np.array_equal(again.image_bgr, first.image_bgr)  # else it would be taken for a frozen video
    assert np.abs(again.image_bgr.astype(int) - first.image_bgr).max() == 1
    source.close()


def test_it_plays_at_its_own_pace_on_the_clock(tmp_path: Path) -> None:
    source, clock = paced(tmp_path)
    must(source)
    clock.advance(7.0)
    source.play()
    assert read(source) is None
    for index in range(1, 5):
        clock.advance(0.0501)
        frame = must(source)
        assert (frame.index, frame.place) == (index, Place.PLAYING)
        assert frame.t_arrival_s == pytest.approx(57.0 + index * 0.05)
        assert frame.t_video_s == pytest.approx(index * 0.05)
        assert read(source) is None
    source.close()


def test_a_reader_that_is_late_gets_the_newest_and_a_gap_in_the_numbers(tmp_path: Path) -> None:
    source, clock = paced(tmp_path)
    first = must(source)
    source.play()
    read(source)
    clock.advance(0.16)
    frame = must(source)
    assert (frame.index, frame.seq) == (3, first.seq + 3)
    source.close()


def test_it_stands_at_the_last_picture_until_it_is_rewound(tmp_path: Path) -> None:
    source, clock = paced(tmp_path)
    must(source)
    source.play()
    read(source)
    clock.advance(1.0)
    last = must(source)
    assert (last.index, last.place) == (5, Place.PLAYING)
    clock.advance(0.3)
    standing = must(source)
    assert (standing.index, standing.place) == (5, Place.END)
    source.play()  # nothing to play on
    clock.advance(0.3)
    assert must(source).place is Place.END
    source.rewind()
    first = must(source)
    assert (first.index, first.place) == (0, Place.START)
    assert first.seq > standing.seq
    source.play()
    read(source)
    clock.advance(0.06)
    assert must(source).index == 1
    source.close()


def test_the_limit_is_an_end(tmp_path: Path) -> None:
    source, clock = paced(tmp_path, limit_s=0.11)
    must(source)
    source.play()
    read(source)
    clock.advance(1.0)
    assert must(source).index == 2
    clock.advance(0.3)
    assert must(source).place is Place.END
    source.close()


def test_a_file_that_is_gone_ends_it_with_a_reason(tmp_path: Path) -> None:
    source, clock = paced(tmp_path)
    must(source)
    (tmp_path / "a.mp4").unlink()
    source.rewind()
    assert read(source) is None
    assert source.ended
    assert source.problem is not None
    assert "no such file" in source.problem
    with pytest.raises(VideoError):
        PacedSource(lambda: open_source(str(tmp_path / "a.mp4")), clock)
