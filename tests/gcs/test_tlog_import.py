"""Telemetry logs of other stations become flights: whatever is wrong with them is told in one line."""

from __future__ import annotations

import json
import struct
from itertools import pairwise
from pathlib import Path

import pytest

from control.engagement import State
from control.types import VehicleMode
from gcs.cli import entry as cli
from gcs.errors import EXIT_USAGE
from gcs.recorder.events import Received
from gcs.recorder.manifest import read_manifest
from gcs.replay.log import FlightLog, TickRow
from gcs.report.make import report_of
from gcs.tlog_import.command import Imported, import_flight
from gcs.tlog_import.tlog import Tlog, TlogError
from sitl_mocks.vehicle import Personality
from tests.gcs.tlog_rig import UNIX_S, heartbeat, station_frames, vehicle_frames, write_records, write_tlog


@pytest.fixture(scope="module")
def frames() -> list[tuple[float, bytes]]:
    return vehicle_frames(6.0)


def imported(folder: Path) -> tuple[list[TickRow], list[Received]]:
    rows = [message for _, _, message in FlightLog(folder)]
    return [row for row in rows if isinstance(row, TickRow)], [row for row in rows if isinstance(row, Received)]


@pytest.mark.parametrize("personality", list(Personality))
def test_a_log_becomes_a_flight(personality: Personality, tmp_path: Path) -> None:
    frames = vehicle_frames(6.0, personality=personality)
    tlog = write_tlog(tmp_path / "their.tlog", [*frames, *station_frames(6.0)])
    told = import_flight(tlog, tmp_path / "flight")
    assert told.notes == ()
    assert told.messages == len(frames)
    ticks, received = imported(tmp_path / "flight")
    assert [row.data for row in received] == [frame for _, frame in frames], "the vehicle's own, none of the station's"
    last = ticks[-1]
    assert 50 <= len(ticks) <= 61, "ten a second, from the first heartbeat on"
    assert last.output.state is State.NO_VIDEO
    vehicle = last.inputs.vehicle
    assert vehicle.mode is VehicleMode.HOLD
    assert vehicle.armed
    assert vehicle.height_m == pytest.approx(12.0, abs=0.3)
    assert vehicle.position_ned_m[2] == pytest.approx(-12.0, abs=0.3)
    manifest = read_manifest(tmp_path / "flight")
    assert manifest.kind == "import"
    assert manifest.ended is not None
    assert manifest.unix_s(ticks[0].t_s) == pytest.approx(min(frames)[0], abs=0.2)
    assert (tmp_path / "flight" / "flight.tlog").read_bytes() == tlog.read_bytes()


def test_report_replay_and_export_take_it(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    import_flight(write_tlog(tmp_path / "their.tlog", frames), folder)
    report = report_of(folder)
    assert report.lasted_s == pytest.approx(6.0, abs=0.2)
    assert cli.main(["report", str(folder)]) == 0
    assert cli.main(["replay", str(folder), "--no-page", "--speed", "20"]) == 0
    assert cli.main(["export", str(folder)]) == 0


@pytest.mark.parametrize("how", [["--verify"], ["--verify", "--from", "control"], ["--with", "mine.yaml"]])
def test_it_is_not_flown_again(
    frames: list[tuple[float, bytes]], tmp_path: Path, how: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    import_flight(write_tlog(tmp_path / "their.tlog", frames), tmp_path / "flight")
    assert cli.main(["replay", str(tmp_path / "flight"), *how]) == EXIT_USAGE
    assert (
        capsys.readouterr().err == f"gcs: {tmp_path}/flight: another station's flight, so nothing here decided in it\n"
    )


def test_of_two_vehicles_one_is_chosen(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    other = vehicle_frames(6.0, personality=Personality.ARDUPILOT, system_id=2)
    tlog = write_tlog(tmp_path / "both.tlog", [*frames, *other])
    with pytest.raises(TlogError, match=r"PX4 \(system 1\), ArduCopter \(system 2\); choose one with --system"):
        import_flight(tlog, tmp_path / "flight")
    assert not (tmp_path / "flight").exists()
    told = import_flight(tlog, tmp_path / "flight", system_id=2)
    assert told.vehicle == "ArduCopter (system 2)"
    assert told.messages == len(other)
    with pytest.raises(TlogError, match=r"no vehicle of system 7: there is PX4"):
        import_flight(tlog, tmp_path / "none", system_id=7)


def test_clocks_that_are_set_meanwhile(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    """A station that boots in 1970 and hears the time later; and one whose clock is put back by an hour."""
    span_s = frames[-1][0] - frames[0][0]
    for name, shift in (("boot", -UNIX_S), ("summer", 3700.0)):
        half = len(frames) // 2
        shifted = [(unix_s + shift, frame) for unix_s, frame in frames[:half]]
        tlog = write_records(tmp_path / f"{name}.tlog", [*shifted, *frames[half:]])
        told = import_flight(tlog, tmp_path / name)
        assert "the clock was set 1 times" in told.notes[0]
        assert told.log_s == pytest.approx(span_s, abs=0.1)
        ticks, _ = imported(tmp_path / name)
        times_s = [row.t_s for row in ticks]
        assert times_s == sorted(times_s)
        end_unix_s = read_manifest(tmp_path / name).unix_s(times_s[-1])
        assert end_unix_s == pytest.approx(frames[-1][0], abs=0.2), "by the clock as it was set last"


def test_frames_a_little_out_of_order_cost_no_time(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    swapped = [(unix_s - 0.03 * (number % 2), frame) for number, (unix_s, frame) in enumerate(frames)]
    told = import_flight(write_records(tmp_path / "x.tlog", swapped), tmp_path / "flight")
    assert told.notes == ()
    assert told.log_s == pytest.approx(frames[-1][0] - frames[0][0], abs=0.05)


def test_stamps_the_other_way_round(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    """As QGroundControl once wrote them."""
    records = [struct.pack("<Q", int(unix_s * 1e6)) + frame for unix_s, frame in frames]
    (tmp_path / "x.tlog").write_bytes(b"".join(records))
    told = import_flight(tmp_path / "x.tlog", tmp_path / "flight")
    assert told.notes == ()
    assert told.log_s == pytest.approx(frames[-1][0] - frames[0][0], abs=0.01)
    assert read_manifest(tmp_path / "flight").unix_start_s == pytest.approx(frames[0][0], abs=0.01)


def test_a_pause_of_the_link_stays_a_pause(tmp_path: Path) -> None:
    later = vehicle_frames(3.0, start_s=UNIX_S + 63.0)
    tlog = write_tlog(tmp_path / "x.tlog", [*vehicle_frames(3.0), *later])
    told = import_flight(tlog, tmp_path / "flight")
    assert told.log_s == pytest.approx(66.0, abs=0.1)
    ticks, _ = imported(tmp_path / "flight")
    gaps_s = [after.t_s - before.t_s for before, after in pairwise(ticks)]
    assert max(gaps_s) == pytest.approx(55.0, abs=1.0), "5 s of silence are told, the rest is not"


def test_damage_is_left_out_and_counted(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    unknown = bytes.fromhex("fd0400000001 01 fffe7f 01020304 0000".replace(" ", ""))  # a kind that nobody knows
    wrong = bytearray(frames[50][1])
    wrong[-1] ^= 0xFF
    records = [*frames[:100], (frames[100][0], unknown), (frames[100][0], bytes(wrong)), *frames[100:]]
    tlog = write_records(tmp_path / "x.tlog", records)
    data = tlog.read_bytes()
    cut = len(data) // 2
    garbage = bytes(range(200)) * 3
    tlog.write_bytes(data[:cut] + garbage + data[cut:-5])
    told = import_flight(tlog, tmp_path / "flight")
    assert len(frames) - 5 <= told.messages <= len(frames)
    said = " ".join(told.notes)
    assert "bytes between its frames were left out" in said
    assert "1 frames of kinds that are not known here" in said
    assert "frames with a wrong checksum" in said


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"Mission Planner log\n" * 200, "not a telemetry log"),
        (struct.pack(">Q", int(UNIX_S * 1e6)) + heartbeat(1, 3), "neither a PX4 nor an ArduPilot multicopter"),
        (struct.pack(">Q", int(UNIX_S * 1e6)) + heartbeat(6, 8), "only ground stations"),
        (heartbeat(2, 12) * 100, "telemetry log"),  # MAVLink without times
    ],
)
def test_what_is_no_log_of_a_vehicle_is_one_line(
    content: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.tlog"
    path.write_bytes(content)
    assert cli.main(["import", str(path), "--out", str(tmp_path / "flight")]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert "x.tlog" in line
    assert words in line
    assert not (tmp_path / "flight").exists()


def test_other_misuse_is_one_line(
    frames: list[tuple[float, bytes]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tlog = write_tlog(tmp_path / "x.tlog", frames)
    taken = tmp_path / "taken"
    import_flight(tlog, taken)
    (tmp_path / "film.mp4").write_bytes(b"no film")
    for argv, words in (
        ([str(tmp_path / "none.tlog")], "none.tlog: no such file"),
        ([str(tmp_path)], "is a directory"),
        ([str(tlog), "--offset", "3"], "--offset: only with --video"),
        ([str(tlog), "--out", str(taken)], "holds a flight already"),
        ([str(tlog), "--video", str(tmp_path / "film.mp4"), "--out", str(tmp_path / "new")], "film.mp4"),
    ):
        assert cli.main(["import", *argv]) == EXIT_USAGE
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    assert not (tmp_path / "new").exists()


def test_json_tells_what_was_found(
    frames: list[tuple[float, bytes]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tlog = write_tlog(tmp_path / "x.tlog", frames)
    assert cli.main(["import", str(tlog), "--out", str(tmp_path / "flight"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == set(Imported.__struct_fields__)
    assert told["vehicle"] == "PX4 (system 1)"


def test_a_log_cut_off_anywhere_is_read_up_to_there(frames: list[tuple[float, bytes]], tmp_path: Path) -> None:
    whole = write_tlog(tmp_path / "x.tlog", frames).read_bytes()
    for end in range(len(whole) - 60, len(whole)):
        (tmp_path / "cut.tlog").write_bytes(whole[:end])
        log = Tlog(tmp_path / "cut.tlog")
        count = sum(1 for _ in log)
        log.close()
        ends, at = 0, 0
        while at < end:
            length = 8 + 12 + whole[at + 9]
            ends, at = ends + (at + length <= end), at + length
        assert count == ends
