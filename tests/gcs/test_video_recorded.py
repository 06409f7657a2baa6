from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs.errors import VideoError
from gcs.video import Frame, VideoSource, open_source
from gcs.video.frame import Decoded, check_size, nominal_fps, redact
from gcs.video.opencv import CvDecoder
from gcs.video.pyav import AvDecoder, is_installed
from gcs.video.recorded import RecordedSource
from tests.gcs.clips import SIZE, box_at, index_first, picture, write_clip, write_folder


def read_all(source: VideoSource) -> list[Frame]:
    frames = []
    while (frame := source.read()) is not None:
        frames.append(frame)
    return frames


def test_a_file_gives_every_frame_with_its_own_times(tmp_path: Path) -> None:
    source = open_source(str(write_clip(tmp_path / "a.mp4", frames=20, fps=20.0)))
    assert (source.size, source.fps, source.frame_count, source.is_live) == (SIZE, 20.0, 20, False)
    frames = read_all(source)
    assert [f.seq for f in frames] == list(range(20))
    assert [f.t_capture_s for f in frames] == pytest.approx([i / 20 for i in range(20)], abs=1e-3)
    assert source.ended
    assert source.problem is None
    x, y = (int(v) for v in box_at(11)[:2])
    assert frames[11].image_bgr[y + 3, x + 3].tolist() == pytest.approx([40, 60, 220], abs=25)
    source.close()


def test_an_image_folder_is_read_in_the_order_of_names(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "images", frames=5)
    (folder / "notes.txt").write_text("not an image")
    source = open_source(str(folder), fps=10.0)
    frames = read_all(source)
    assert source.frame_count == 5
    assert [f.t_capture_s for f in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert all(np.array_equal(f.image_bgr, picture(i)) for i, f in enumerate(frames))


def test_missing_file() -> None:
    with pytest.raises(VideoError, match=r"nowhere\.mp4: no such file"):
        open_source("nowhere.mp4")


@pytest.mark.parametrize("content", [b"these are only words\n" * 50, b"", b"\x00\x00\x00\x18ftypmp42" + b"\0" * 64])
def test_a_file_that_is_no_video(tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "words.mp4"
    path.write_bytes(content)
    with pytest.raises(VideoError) as caught:
        open_source(str(path))
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""  # FFmpeg's own chatter stays off the user's screen


def test_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="no images"):
        open_source(str(tmp_path))


def test_a_truncated_file_gives_its_frames_and_then_says_how_many(tmp_path: Path) -> None:
    whole = index_first(write_clip(tmp_path / "a.mp4", frames=40))
    assert len(read_all(open_source(str(whole)))) == 40  # the moved index is right: only the cut below is at fault
    cut = tmp_path / "cut.mp4"
    data = whole.read_bytes()
    cut.write_bytes(data[: int(len(data) * 0.6)])
    source = open_source(str(cut))
    frames = read_all(source)
    assert 5 < len(frames) < 38
    assert source.problem == f"{cut}: truncated, only {len(frames)} of 40 frames are there"


def test_truncated_before_its_index_is_no_video(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mp4")
    path.write_bytes(path.read_bytes()[:1500])
    with pytest.raises(VideoError, match=r"a\.mp4"):
        open_source(str(path))


def test_a_broken_image_ends_the_folder_with_its_name(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "images", frames=4)
    (folder / "000002.png").write_bytes(b"\x89PNG broken")
    source = open_source(str(folder))
    assert len(read_all(source)) == 2
    assert source.problem is not None
    assert "000002.png: not an image (after 2 frames)" in source.problem


def test_a_png_that_claims_more_bytes_than_it_has_is_not_even_begun(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "images", frames=2)
    data = (folder / "000001.png").read_bytes()
    (folder / "000001.png").write_bytes(data.replace(b"\0\0\0\rIHDR", b"\x7f\xff\xff\xffIHDR"))
    source = open_source(str(folder))
    assert len(read_all(source)) == 1
    assert "000001.png: not an image" in str(source.problem)


@pytest.mark.skipif(not is_installed(), reason="PyAV is not installed")
def test_a_codec_that_nobody_knows_is_no_video(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mp4", frames=3)
    path.write_bytes(path.read_bytes().replace(b"mp4v", b"zzzz").replace(b"esds", b"zzzz"))
    with pytest.raises(VideoError, match=r"a\.mp4: holds no video"):
        AvDecoder(str(path), live=False)


def test_an_image_of_another_size_ends_the_folder(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "images", frames=3)
    cv2.imwrite(str(folder / "000003.png"), np.zeros((50, 60, 3), np.uint8))
    source = open_source(str(folder))
    assert len(read_all(source)) == 3
    assert source.problem is not None
    assert "frame 3 is 60x50 px" in source.problem


class ScriptedDecoder:
    fps = 10.0
    frame_count = None

    def __init__(self, times_s: list[float | None]) -> None:
        self._times_s = iter(times_s)

    def read(self) -> Decoded | None:
        for pts_s in self._times_s:
            return Decoded(picture(0), pts_s)
        return None

    def close(self) -> None:
        pass


def test_times_always_rise_even_where_the_containers_do_not() -> None:
    source = RecordedSource("x", ScriptedDecoder([5.0, 5.0, 4.0, 5.5, None]))
    assert [f.t_capture_s for f in read_all(source)] == pytest.approx([0.0, 0.1, 0.2, 0.5, 0.6])


def test_too_large_a_picture_is_refused() -> None:
    check_size("x", 4096, 2160)
    check_size("x", 2160, 3840)
    with pytest.raises(VideoError, match="8192x16 px"):
        check_size("x", 8192, 16)
    with pytest.raises(VideoError, match="4000x4000"):
        check_size("x", 4000, 4000)


def test_unknown_scheme() -> None:
    with pytest.raises(VideoError, match="unknown kind of address"):
        open_source("gopher://example.org/video")


def test_passwords_never_show() -> None:
    assert redact("rtsp://user:secret@10.0.0.2/live") == "rtsp://***@10.0.0.2/live"
    assert redact("rtsp://user:s@cret@10.0.0.2/live") == "rtsp://***@10.0.0.2/live"
    assert (
        redact("rtsp://h/live?channel=1&user=me&password=x%20y&s=1")
        == "rtsp://h/live?channel=1&user=***&password=***&s=1"
    )
    assert redact("rtsp://h:554/user=me_password=x_channel=1.sdp") == "rtsp://h:554/user=***"
    assert redact("srt://h:9000?passphrase=abcdefghij&mode=caller") == "srt://h:9000?passphrase=***&mode=caller"
    assert redact("camera:0?width=1280&height=720") == "camera:0?width=1280&height=720"
    assert nominal_fps(90000.0) is None


@pytest.mark.skipif(not is_installed(), reason="PyAV is an optional extra")
def test_pyav_and_opencv_read_the_same_file_alike(tmp_path: Path) -> None:
    path = str(write_clip(tmp_path / "a.mp4"))
    with_av = read_all(RecordedSource(path, AvDecoder(path, live=False)))
    with_cv = read_all(RecordedSource(path, CvDecoder(path, live=False)))
    assert [f.t_capture_s for f in with_av] == pytest.approx([f.t_capture_s for f in with_cv], abs=1e-3)
    difference = np.abs(with_av[9].image_bgr.astype(int) - with_cv[9].image_bgr.astype(int))
    assert difference.mean() < 2.0
