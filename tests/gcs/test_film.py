"""The film of a flight on disks that are full, slow or gone, cut off anywhere, damaged, and from elsewhere."""

from __future__ import annotations

import errno
import shutil
import threading
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.recorder.film import Film
from gcs.recorder.film_index import INDEX
from gcs.recorder.film_reader import FilmReader
from gcs.video.frame import fingerprint
from gcs.video.live import LiveSource
from gcs.video.pyav import is_installed
from gcs.video.tap import Coding, Library
from tests.gcs import clips
from tests.gcs.film_rig import Packet, feed, filmed, h264, jpegs
from tests.gcs.waiting import wait_for

needs_av = pytest.mark.skipif(not is_installed(), reason="H.264 needs PyAV")
MJPEG, H264 = Coding("mjpeg", Library.OPENCV), Coding("h264", Library.FFMPEG)


def written(folder: Path, coding: Coding, packets: list[Packet]) -> Path:
    """A film of these packets."""
    folder.mkdir(exist_ok=True)
    film = Film(folder)
    assert film.opened(coding)
    feed(film, packets)
    film.close()
    assert film.problem is None
    return folder


@pytest.fixture(scope="module", params=["mjpeg", "h264"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if request.param == "h264" and not is_installed():
        pytest.skip("H.264 needs PyAV")
    coding, packets = (MJPEG, jpegs(12)) if request.param == "mjpeg" else (H264, h264(30))
    return written(tmp_path_factory.mktemp(request.param), coding, packets)


def prints_of(reader: FilmReader) -> list[int | None]:
    """Of all pictures, in order."""
    images = [reader.picture(packet.number) for packet in reader.packets()]
    return [None if image is None else fingerprint(image) for image in images]


@settings(max_examples=60, deadline=None)
@given(index=st.floats(0.0, 1.0), film=st.floats(0.0, 1.0))
def test_cut_off_anywhere_it_opens_up_to_there(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, index: float, film: float
) -> None:
    """As a killed program, or a power cut, leaves both files: at any byte, and either may be ahead."""
    folder = tmp_path_factory.mktemp("cut")
    for path in whole.iterdir():
        share = index if path.name == INDEX else film
        (folder / path.name).write_bytes(path.read_bytes()[: round(share * path.stat().st_size)])
    complete, reader = FilmReader(whole), FilmReader(folder)
    lines = (folder / INDEX).read_bytes().count(b"\n")
    data_bytes = (folder / next(path.name for path in whole.iterdir() if path.name != INDEX)).stat().st_size
    packets = list(complete.packets())
    ends = np.cumsum([len(packet.data) for packet in packets])
    expected = min(max(lines - 1, 0), int((ends <= data_bytes).sum()))
    assert len(reader) in (expected, expected + 1)  # one more where only its line's end was cut off
    assert list(reader.packets()) == packets[: len(reader)]
    assert prints_of(reader) == prints_of(complete)[: len(reader)]
    assert (reader.problem is None) == (len(reader) > 0)
    shutil.rmtree(folder)


@pytest.mark.parametrize("line", [b"\xff\xfe\n", b"{}\n", b'{"type":"packet","n":"x"}\n', b"[" * 100_000 + b"\n"])
def test_damaged_lines_cost_their_packets_alone(whole: Path, tmp_path: Path, line: bytes) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    lines = (whole / INDEX).read_bytes().splitlines(keepends=True)
    lines[5] = line
    (tmp_path / INDEX).write_bytes(b"".join(lines))
    reader = FilmReader(tmp_path)
    assert len(reader) == len(FilmReader(whole)) - 1
    assert reader.problem == f"{tmp_path / INDEX}: 1 of its lines cannot be read: their pictures are missing"
    assert reader.picture(4) is None
    assert reader.picture(next(p.number for p in reader.packets() if p.number > 4 and p.is_key)) is not None


@pytest.mark.parametrize(
    ("index", "problem"),
    [
        (None, "no film in it"),
        (b"", "film.jsonl: no packet of its film is there"),
        (b"hello\n", "film.jsonl: 1 of its lines cannot be read"),
        (b'{"type":"stream","file":"../film.h264","codec":"h264","library":"ffmpeg"}\n', "1 of its lines"),
        (b'{"type":"stream","file":"/etc/passwd","codec":"h264","library":"ffmpeg"}\n', "1 of its lines"),
        (b'{"type":"stream","file":"film.h264","codec":"h264","library":"ffmpeg"}\n', "film.h264: no such file"),
    ],
)
def test_what_is_no_film_says_so(tmp_path: Path, index: bytes | None, problem: str) -> None:
    if index is not None:
        (tmp_path / INDEX).write_bytes(index)
    reader = FilmReader(tmp_path)
    assert problem in (reader.problem or "")
    assert (reader.size, reader.codec, len(reader), reader.picture(0), reader.is_exact) == (None, None, 0, None, False)


@needs_av
def test_a_codec_that_nobody_knows(tmp_path: Path) -> None:
    (tmp_path / "film.h264").write_bytes(b"abc")
    stream = b'{"type":"stream","file":"film.h264","codec":"nonesuch","library":"ffmpeg"}\n'
    (tmp_path / INDEX).write_bytes(stream + b'{"type":"packet","n":0,"at":0,"size":3,"t_arrival_s":1.0}\n')
    reader = FilmReader(tmp_path)
    assert reader.picture(0) is None
    assert reader.problem == f"{tmp_path / 'film.h264'}: nonesuch cannot be decoded here"


def test_without_pyav_a_film_of_h264_says_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path, H264, [Packet(b"\0\0\1\x65", True)])
    monkeypatch.setattr("gcs.video.pyav.is_installed", lambda: False)
    reader = FilmReader(tmp_path)
    assert reader.picture(0) is None
    assert "needs PyAV" in (reader.problem or "")


@needs_av
def test_switched_off_and_on_it_goes_on_with_a_key_frame(tmp_path: Path) -> None:
    film, packets = Film(tmp_path), h264(40)
    film.opened(H264)
    feed(film, packets[:12])
    film.on = False
    feed(film, packets[12:15])
    film.on = True
    feed(film, packets[15:])
    film.close()
    reader = FilmReader(tmp_path)
    assert [packet.number for packet in reader.packets()] == [*range(12), *range(20, 40)]
    assert (film.dropped, reader.problem, reader.picture(14)) == (0, None, None)
    full = FilmReader(written(tmp_path / "full", H264, packets))
    assert prints_of(reader) == prints_of(full)[:12] + prints_of(full)[20:]


@needs_av
def test_going_far_ahead_and_back_is_the_same(tmp_path: Path) -> None:
    reader = FilmReader(written(tmp_path, H264, h264(700, gop=25)))
    expected = prints_of(reader)
    for number in (3, 690, 40, 41, 0, 699, 699, 350):
        image = reader.picture(number)
        assert image is not None
        assert fingerprint(image) == expected[number]


def test_nothing_filmed_leaves_nothing(tmp_path: Path) -> None:
    film = Film(tmp_path)
    film.opened(MJPEG)
    film.close()
    assert list(tmp_path.iterdir()) == []
    assert feed(film, jpegs(1)) == [0]  # the source ends after the film


class Camera:
    """A decoder that knows no packets."""

    fps, frame_count = 25.0, None

    def __init__(self, pictures: int) -> None:
        self._left = pictures

    def read(self) -> Any:
        from gcs.video.frame import Decoded

        self._left -= 1
        return Decoded(clips.picture(self._left)) if self._left >= 0 else None

    def close(self) -> None:
        pass


def test_pictures_without_packets_are_kept_nearly(tmp_path: Path) -> None:
    film = Film(tmp_path)
    source = LiveSource("camera", lambda: Camera(15), reconnect=False, tap=film)
    frames = filmed(tmp_path, film, source, 15)
    reader = FilmReader(tmp_path)
    assert (len(reader), reader.is_exact, reader.size) == (15, False, clips.SIZE)
    image = reader.picture(frames[-1].packet if frames[-1].packet is not None else -1)
    assert image is not None
    assert np.abs(image.astype(int) - frames[-1].image_bgr).mean() < 6


def test_a_codec_of_no_known_file_is_kept_as_pictures(tmp_path: Path) -> None:
    film = Film(tmp_path)
    assert not film.opened(Coding("vp8", Library.FFMPEG))
    film.picture(clips.picture(0), 1.0)
    film.close()
    assert "no film of vp8 as it came" in (film.problem or "")
    assert not FilmReader(tmp_path).is_exact
    assert FilmReader(tmp_path).picture(0) is not None
    again = Film(tmp_path)
    again.opened(MJPEG)
    feed(again, jpegs(2))
    again.picture(clips.picture(0), 1.0)  # a stream that was read with something else when it came back
    again.close()
    reader = FilmReader(tmp_path)
    assert (len(reader), reader.is_exact) == (3, False)


class Disk:
    """One that stalls until `free` is set, or takes `room` bytes."""

    def __init__(self, room: int | None = None) -> None:
        self.free = threading.Event()
        self.room = room

    def open(self, path: Path) -> IO[bytes]:
        file, disk = path.open("wb"), self

        class File:
            def write(self, data: bytes) -> int:
                disk.free.wait()
                if disk.room is not None:
                    disk.room -= len(data)
                    if disk.room < 0:
                        raise OSError(errno.ENOSPC, "No space left on device")
                return file.write(data)

            def __getattr__(self, name: str) -> Any:
                return getattr(file, name)

        return File()  # type: ignore[return-value]


def test_a_full_disk_ends_the_film_alone(tmp_path: Path) -> None:
    packets = jpegs(30)
    disk = Disk(room=sum(len(packet.data) for packet in packets[:20]))
    disk.free.set()
    film = Film(tmp_path, open_file=disk.open)
    film.opened(MJPEG)
    feed(film, packets[:5])
    wait_for(lambda: film._held_bytes == 0)
    feed(film, packets[5:])
    film.close()
    assert film.problem == f"{tmp_path}: the film ends here: no space left on device"
    assert film.dropped > 0
    reader = FilmReader(tmp_path)
    assert len(reader) >= 5
    assert reader.problem is None
    assert [packet.data for packet in reader.packets()] == [packet.data for packet in packets[: len(reader)]]


@needs_av
def test_a_disk_that_stalls_thins_the_film(tmp_path: Path) -> None:
    """Nobody waits for it; what is missing is missing up to a key frame, and the rest is as it was."""
    packets, disk = h264(60), Disk()
    film = Film(tmp_path, held_bytes=sum(len(packet.data) for packet in packets[:25]), open_file=disk.open)
    film.opened(H264)
    feed(film, packets[:45])
    disk.free.set()
    wait_for(lambda: film._held_bytes == 0)
    feed(film, packets[45:])
    film.close()
    assert film.dropped > 0
    assert film.problem is None
    kept = [packet.number for packet in FilmReader(tmp_path).packets()]
    assert kept[:20] == list(range(20))
    assert kept[-10:] == list(range(50, 60))
    full = prints_of(FilmReader(written(tmp_path / "full", H264, packets)))
    assert prints_of(FilmReader(tmp_path)) == [full[number] for number in kept]


def test_a_folder_that_is_gone(tmp_path: Path) -> None:
    film = Film(tmp_path / "gone")
    film.opened(MJPEG)
    feed(film, jpegs(1))
    film.close()
    assert film.problem == f"{tmp_path / 'gone'}: the film ends here: no such file or directory"
