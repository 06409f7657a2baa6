"""Golden flights: recorded once by `gcs demo`, flown again by every run of the tests.

    python -m tests.replay.golden make NAME FLIGHT [--until S] [--film]   # of a recorded flight
    make golden-update                                                    # accept what comes out now

A golden flight holds what came from outside, what came out of it, and course.txt: the same to be read, so that a change
of behaviour is seen in a diff. The film, where there is one, is encoded anew and much smaller; the flight is then what
comes out of that film.
"""

from __future__ import annotations

import argparse
import lzma
import shutil
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import av
import msgspec

from gcs.recorder.film import Film as FilmWriter
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.manifest import MANIFEST, read_manifest, write_manifest
from gcs.recorder.message_log import encoder
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, FrameRow, TickRow
from gcs.verify.again import Again, recorded_seen
from gcs.verify.verify import Recorded, track_again
from gcs.video.tap import Coding, Library

GOLDEN: Final = Path(__file__).parent / "golden"
COURSE: Final = "course.txt"
_PACKED: Final = f"{MESSAGES}.xz"
_EVERY_S: Final = 0.5


def flights() -> list[Path]:
    """All there are."""
    return sorted(path for path in GOLDEN.iterdir() if (path / MANIFEST).exists())


def unpack(golden: Path, folder: Path) -> Path:
    """As a flight's folder, at `folder`."""
    shutil.copytree(golden, folder, dirs_exist_ok=True)
    (folder / MESSAGES).write_bytes(lzma.decompress((folder / _PACKED).read_bytes()))
    (folder / _PACKED).unlink()
    return folder


def has_film(golden: Path) -> bool:
    """Whether the tracker can be run again too."""
    return (golden / "film.jsonl").exists()


class _Outcome:
    """The latest event that came out."""

    def __init__(self) -> None:
        self.made: object | None = None

    def event(self, what: str, frame: int | None, t_s: float, recorded: msgspec.Raw, again: object) -> None:
        self.made = again


def fly_anew(folder: Path) -> None:
    """Put what comes out now into the log in the place of what came out then."""
    recorded, outcome = Recorded.open(folder), _Outcome()
    seen: dict[int, Any] = {}
    if has_film(folder):
        seen, problem = track_again(recorded, recorded.config, print)
        assert problem is None, problem
    again = Again(recorded.config, recorded.size, outcome, flown=recorded.config)
    encode, lines = encoder().encode, []
    run = again.run(recorded.log.with_data(), lambda number, row: seen.get(number) or recorded_seen(number, row))
    for n, ((entry, raw), _) in enumerate(zip(recorded.log.with_data(), run, strict=True)):
        t_s, frame, message = entry
        data = raw if outcome.made is None else msgspec.Raw(encode(outcome.made))
        row = {"n": n, "t_s": t_s, "type": _name(message), "frame": frame, "data": data}
        lines.append(encode(row) + b"\n")
        outcome.made = None
    (folder / MESSAGES).write_bytes(b"".join(lines))


def _name(message: object) -> str:
    return {FrameRow: "FrameRecord", TickRow: "Tick"}.get(type(message), type(message).__name__)


def course(folder: Path) -> str:
    """Twice a second what was decided, and every change of state: for people who read a diff."""
    log = FlightLog(folder)
    lines, due_s, before, box = [], log.start_s, "", ""
    for _, _, message in log:
        if isinstance(message, FrameRow):
            box = "" if message.result is None else _box(message)
        if not isinstance(message, TickRow):
            continue
        output, sent = message.output, message.setpoint
        state = " ".join(["engaging" if output.engaging else output.state.value, *(c.name for c in output.reasons)])
        if message.t_s < due_s and state == before:
            continue
        due_s, before = message.t_s + _EVERY_S, state
        setpoint = "-" if sent is None else "{:+.2f} {:+.2f} {:+.2f}".format(*sent.velocity_ned_mps)
        turn = "" if sent is None else f"{sent.yaw_rate_rps:+.3f}"
        lines.append(f"{message.t_s - log.start_s:7.2f}  {state:40s} {box:28s} {setpoint:22s} {turn}".rstrip())
    titles = "state and reasons", "box x y w h px", "north east down m/s"
    head = "time s   {:40s} {:28s} {:22s} yaw rad/s".format(*titles)
    return "\n".join([head, *lines]) + "\n"


def _box(row: FrameRow) -> str:
    result = row.tracked
    if result is None:
        return ""
    return "{:6.1f} {:6.1f} {:5.1f} {:5.1f}".format(*result.box.xywh) + ("" if result.visible else " hidden")


def pack(folder: Path, golden: Path) -> None:
    """The files of a golden flight, of a flight's folder."""
    golden.mkdir(parents=True, exist_ok=True)
    for path in (folder / MANIFEST, *folder.glob("film*")):
        shutil.copy(path, golden / path.name)
    (golden / _PACKED).write_bytes(lzma.compress((folder / MESSAGES).read_bytes(), preset=9 | lzma.PRESET_EXTREME))
    (golden / COURSE).write_text(course(folder))


def make(name: str, flight: Path, until_s: float, *, with_film: bool) -> None:
    """A golden flight of the first until_s seconds of a recorded one."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        manifest = read_manifest(flight)
        log = FlightLog(flight)
        encode = encoder().encode
        writer, film = FilmWriter(folder) if with_film else None, Film(flight)
        shrink = _Shrink(writer, *film.size) if writer is not None else None
        with (folder / MESSAGES).open("wb") as file:
            for n, ((t_s, frame, message), raw) in enumerate(log.with_data()):
                if t_s > log.start_s + until_s:
                    break
                data: Any = raw
                if isinstance(message, FrameRow):
                    data = msgspec.json.decode(raw)
                    data["packet"] = shrink.add(film, message) if shrink is not None else None
                file.write(encode({"n": n, "t_s": t_s, "type": _name(message), "frame": frame, "data": data}) + b"\n")
        if writer is not None:
            writer.close()
        facts = {
            "kind": "golden",
            "machine": {"architecture": manifest.machine.get("architecture", "")},
            "problems": (),
        }
        write_manifest(folder, msgspec.structs.replace(manifest, **facts))
        fly_anew(folder)
        shutil.rmtree(GOLDEN / name, ignore_errors=True)
        pack(folder, GOLDEN / name)


class _Shrink:
    """The film once more, a packet for each frame of the log."""

    def __init__(self, film: FilmWriter, width_px: int, height_px: int) -> None:
        self._film = film
        self._codec = av.CodecContext.create("libx264", "w")
        self._codec.width, self._codec.height, self._codec.pix_fmt = width_px, height_px, "yuv420p"
        self._codec.time_base = Fraction(1, 20)
        self._codec.options = {"preset": "slow", "tune": "zerolatency", "crf": "30", "g": "1000"}
        self._codec.open()
        film.opened(Coding("h264", Library.FFMPEG, bytes(self._codec.extradata or b"")))
        self._frames = 0

    def add(self, film: Film, row: FrameRow) -> int:
        frame = av.VideoFrame.from_ndarray(film.picture_of(row), format="bgr24")
        frame.pts, self._frames = self._frames, self._frames + 1
        (packet,) = self._codec.encode(frame)
        return self._film.packet(bytes(packet), row.t_arrival_s, is_key=packet.is_keyframe)


def update() -> None:
    """Accept what comes out now."""
    for golden in flights():
        with tempfile.TemporaryDirectory() as folder:
            flight = unpack(golden, Path(folder))
            before = course(flight)
            fly_anew(flight)
            if (flight / MESSAGES).read_bytes() != lzma.decompress((golden / _PACKED).read_bytes()):
                pack(flight, golden)
            said = "as it was" if course(flight) == before else "another course, see its diff"
            print(f"{golden.name}: {said}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.replay.golden")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("update")
    making = commands.add_parser("make")
    making.add_argument("name")
    making.add_argument("flight", type=Path)
    making.add_argument("--until", type=float, default=30.0)
    making.add_argument("--film", action="store_true")
    given = parser.parse_args()
    if given.command == "make":
        make(given.name, given.flight, given.until, with_film=given.film)
    else:
        update()
