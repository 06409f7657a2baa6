"""Videos made elsewhere beside a telemetry log: each picture at its time, whatever the file holds."""

from __future__ import annotations

from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from control.engagement import State
from gcs.recorder.film_reader import FilmReader
from gcs.replay.log import FlightLog, FrameRow, TickRow
from gcs.tlog_import import video as imported
from gcs.tlog_import.command import import_flight
from gcs.video import pyav
from tests.gcs.stream_sender import SIZE, number_of, numbered
from tests.gcs.tlog_rig import UNIX_S, vehicle_frames, write_tlog

needs_av = pytest.mark.skipif(not pyav.is_installed(), reason="making these files needs PyAV")
FPS, PICTURES = 20, 120
SPAN_S = (PICTURES - 1) / FPS
H265 = {"preset": "ultrafast", "x265-params": "log-level=none"}


@pytest.fixture(scope="module")
def tlog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tlog(tmp_path_factory.mktemp("log") / "their.tlog", vehicle_frames(10.0))


def write_av(path: Path, codec: str, options: dict[str, str], made_unix_s: float | None = None) -> Path:
    """Numbered pictures, one each 50 ms."""
    import av

    with av.open(str(path), "w") as container:
        if made_unix_s is not None:
            made = datetime.fromtimestamp(made_unix_s, UTC).isoformat().replace("+00:00", "Z")
            container.metadata["creation_time"] = made
        stream = container.add_stream(codec, rate=FPS, options=options)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for number in range(PICTURES):
            frame = av.VideoFrame.from_ndarray(numbered(number), format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_cv(path: Path, fourcc: str) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), FPS, SIZE)
    for number in range(PICTURES):
        writer.write(numbered(number))
    writer.release()
    return path


def check(folder: Path, start_s: float, *, exact: bool, most_missing: int = 3) -> list[FrameRow]:
    """Each frame's picture is the one of its time; start_s: of the first, on the flight's clock."""
    rows = [message for _, _, message in FlightLog(folder) if isinstance(message, FrameRow)]
    assert PICTURES - most_missing <= len(rows) <= PICTURES
    reader = FilmReader(folder)
    assert reader.problem is None
    assert reader.is_exact == exact
    for row in rows:
        assert row.packet is not None
        image = reader.picture(row.packet)
        assert image is not None
        assert number_of(np.asarray(image)) == round((row.t_capture_s - start_s) * FPS)
    return rows


@needs_av
@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("b.mp4", "libx264", {"preset": "medium", "bf": "3"}),
        ("plain.mp4", "libx264", {"preset": "ultrafast", "tune": "zerolatency"}),
        ("open.mkv", "libx264", {"preset": "fast", "x264-params": "open-gop=1:keyint=24"}),
        ("h265.mp4", "libx265", H265),
        ("m.avi", "mjpeg", {}),
        ("ts.ts", "libx264", {"preset": "fast"}),
    ],
)
def test_packets_are_taken_as_they_are(
    name: str, codec: str, options: dict[str, str], tlog: Path, tmp_path: Path
) -> None:
    video = write_av(tmp_path / name, codec, options)
    told = import_flight(tlog, tmp_path / "flight", str(video), 2.0)
    assert told.video_s == pytest.approx(SPAN_S, abs=0.01)
    assert told.told_by == "--offset"
    check(tmp_path / "flight", 2.0, exact=True)


@needs_av
def test_a_codec_that_no_film_takes_becomes_pictures(tlog: Path, tmp_path: Path) -> None:
    video = write_av(tmp_path / "v.webm", "libvpx-vp9", {"deadline": "realtime", "cpu-used": "8"})
    import_flight(tlog, tmp_path / "flight", str(video), 2.0)
    check(tmp_path / "flight", 2.0, exact=False, most_missing=0)


@pytest.mark.parametrize("installed", [True, False])
@pytest.mark.parametrize(("name", "fourcc"), [("v.mp4", "mp4v"), ("v.avi", "MJPG")])
def test_with_and_without_pyav(
    name: str, fourcc: str, installed: bool, tlog: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if installed and not pyav.is_installed():
        pytest.skip("needs PyAV")
    monkeypatch.setattr(pyav, "is_installed", lambda: installed)
    import_flight(tlog, tmp_path / "flight", str(write_cv(tmp_path / name, fourcc)), 2.0)
    check(tmp_path / "flight", 2.0, exact=installed)


@needs_av
@pytest.mark.parametrize(
    ("made_s", "offset_s", "told_by"),
    [(2.0, 2.0, "its creation time"), (None, 4.0, "both ending together"), (-86400.0, 4.0, "both ending together")],
)
def test_where_the_video_belongs(
    made_s: float | None, offset_s: float, told_by: str, tlog: Path, tmp_path: Path
) -> None:
    """made_s: what the camera's clock said, from the beginning of the log on; in whole seconds."""
    made = None if made_s is None else UNIX_S + made_s
    video = write_av(tmp_path / "v.mp4", "libx264", {"preset": "ultrafast"}, made)
    told = import_flight(tlog, tmp_path / "flight", str(video))
    assert told.told_by == told_by
    assert told.offset_s == pytest.approx(offset_s, abs=0.15)
    assert told.offset_s is not None
    check(tmp_path / "flight", told.offset_s, exact=True)


@needs_av
def test_a_video_that_began_before_the_log(tlog: Path, tmp_path: Path) -> None:
    video = write_av(tmp_path / "v.mp4", "libx264", {"preset": "ultrafast"})
    told = import_flight(tlog, tmp_path / "flight", str(video), -3.0)
    assert told.notes == ()
    check(tmp_path / "flight", 0.0, exact=True)
    ticks = [message for _, _, message in FlightLog(tmp_path / "flight") if isinstance(message, TickRow)]
    assert ticks[0].t_s >= 3.0
    states = [row.output.state for row in ticks]
    assert states[5] is State.IDLE, "there is a picture"
    assert states[-1] is State.NO_VIDEO, "there is none any more"


@needs_av
def test_a_video_of_another_day_is_said_to_be(tlog: Path, tmp_path: Path) -> None:
    video = write_av(tmp_path / "v.mp4", "libx264", {"preset": "ultrafast"})
    told = import_flight(tlog, tmp_path / "flight", str(video), 500.0)
    assert "lies outside of the log" in told.notes[0]


class Stamp(int):
    """Counts how often any of them is compared."""

    compared = 0

    def __lt__(self, other: int) -> bool:
        Stamp.compared += 1
        return int(self) < int(other)


@needs_av
def test_the_times_of_a_long_video_are_found_in_a_few_looks_at_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a picture that is shown before the one that was sent before it."""
    found = imported.ImportedVideo(write_av(tmp_path / "v.mkv", "mjpeg", {}))
    stamps = [7000 + 50 * number for number in (0, 2, 1, *range(3, 1000))]
    packets = [SimpleNamespace(pts=Stamp(stamp), size=1) for stamp in stamps]
    monkeypatch.setattr(imported, "shown_progress", lambda *_: packets)
    assert found._packet_times_s() == pytest.approx([number / FPS for number in range(1000)])
    assert 0 < Stamp.compared < 20 * len(stamps)
