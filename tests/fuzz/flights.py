"""Damaged flight folders: whole ones, and what may be wrong with their files. Each is told by its number."""

from __future__ import annotations

import copy
import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from gcs.recorder.film_files import FilmFiles
from gcs.video.tap import Coding, Library
from tests.fuzz.videos import damage
from tests.gcs import film_rig, replay_rig, tlog_rig, verify_rig
from tests.replay import golden

NAME: Final = "flight-20260101-000000"  # as recorder.folder names them, so that retention takes it
LOG, MANIFEST, INDEX, TLOG = "messages.jsonl", "manifest.json", "film.jsonl", "flight.tlog"
FILMS: Final = ("film.mjpeg", "film.h264")
_DEEP: Final = 50
_LINES: Final = 400  # of a log: enough to reach every branch, quick enough for thousands of cases
HOSTILE: Final = (
    "\x1b]0;owned\x07\x1b[2J\x1b[31m", "\x9b31m\x85\u2028\u202eabc", "<script>alert(1)</script>", "a\r\nb\tc\x00d",
    "\"><img src=x onerror='alert(1)'>", "</title></style>&lt;", "../../../outside.txt", "/etc/passwd", "x" * 100_000,
    "", "%s{0}{}", "\U0001f6a9", "file:///etc/passwd", "nan", "-", "--out",
)  # fmt: skip
_ABSURD: Final[tuple[Any, ...]] = (
    None, True, False, 0, 1, -1, -7, 1e-320, 1e308, -1e308, 1e18, 1e10, 4e9, -0.0, 1 << 31, 1 << 63, 1 << 64,
    -(1 << 63), 10**40, float("nan"), float("inf"), float("-inf"), [], [[]], {}, {"a": 1}, [1, 2, 3],
    [None] * 3, [1e308] * 3, "x",
)  # fmt: skip
_RAW: Final = (
    b"", b"{}", b"null", b"[]", b"\xff\xfe", b"\x00" * 400, b"[" * 200_000, b'{"n":1,"t_s":1,"type":"Tick","data":{}}',
    b'{"x":' * 100_000, b'"' + b"y" * 1_000_000, b'{"n":0,"t_s":0.0,"type":"Said","frame":null,"data":' + b"[" * 99_999,
    b'{"n":9,"t_s":1e999,"type":"Said","data":{"text":"x"}}', b'{"n":99,"t_s":1e9,"type":"Said","data":{"text":"x"}}',
)  # fmt: skip

Damage = Callable[[Path, random.Random], None]


class Seeds:
    """Flights that are whole, one folder each, and a telemetry log."""

    def __init__(self, folder: Path) -> None:
        self.folders = [folder / "filmed", folder / "full"]
        for path in self.folders:
            path.mkdir(parents=True)
        replay_rig.record_flight(self.folders[0])
        verify_rig.record_flight(self.folders[1])
        _tell_size(self.folders[0] / MANIFEST)
        _film_h264(self.folders[1])
        self.folders += [golden.unpack(each, folder / each.name) for each in golden.flights()]
        for path in self.folders:
            tlog_rig.write_tlog(path / TLOG, tlog_rig.vehicle_frames(3.0))


def _tell_size(manifest: Path) -> None:
    width_px, height_px = replay_rig.SIZE
    video = {"address": "lockstep", "width_px": width_px, "height_px": height_px, "fps": 20.0}
    manifest.write_text(json.dumps({**json.loads(manifest.read_bytes()), "video": video}))


def _film_h264(folder: Path) -> None:
    with FilmFiles(folder, lambda path: path.open("xb")) as files:
        files.begin(Coding("h264", Library.FFMPEG), lossy=False)
        for number, packet in enumerate(film_rig.h264(40)):
            files.add(number, packet.data, 100.0 + number / 20, is_key=packet.is_key, skips=False)


def damaged_flight(seeds: Seeds, folder: Path, rng: random.Random) -> str:
    """A copy with something wrong in it, at `folder`; what."""
    shutil.copytree(rng.choice(seeds.folders), folder)
    _shorten(folder / LOG, rng)
    done = [_one(folder, rng) for _ in range(rng.choice((1, 1, 1, 2, 3)))]
    return " and ".join(dict.fromkeys(done))


def _shorten(log: Path, rng: random.Random) -> None:
    lines = log.read_bytes().splitlines(keepends=True)
    begin = rng.randrange(max(len(lines) - _LINES, 1))
    log.write_bytes(b"".join([*lines[: rng.choice((0, 60))], *lines[begin : begin + _LINES]]))


def _one(folder: Path, rng: random.Random) -> str:
    name = rng.choice((LOG,) * 8 + (MANIFEST,) * 4 + (INDEX,) * 3 + FILMS + (TLOG,))
    path = folder / name
    if not path.is_file():
        return "nothing"
    do, kinds = rng.random(), _OF.get(name, ())
    kind: Damage = rng.choice(kinds) if kinds and do < 0.75 else _bytes if do < 0.9 else _entry
    kind(path, rng)
    return f"{name}, {kind.__name__.strip('_')}"


def _bytes(path: Path, rng: random.Random) -> None:
    path.write_bytes(damage(rng, path.read_bytes() or b"\0"))


def _entry(path: Path, rng: random.Random) -> None:
    """What stands under its name is no file of a flight."""
    path.unlink()
    match rng.randrange(9):
        case 0:
            path.mkdir()
        case 1:
            path.symlink_to("nowhere")
        case 2:
            path.symlink_to(path.name)  # itself
        case 3:
            path.symlink_to("/dev/zero")
        case 4:
            path.symlink_to("/dev/full")
        case 5:
            os.mkfifo(path)
        case 6:
            path.write_bytes(b"")
        case 7:
            path.symlink_to(path.parent / MANIFEST if path.name != MANIFEST else path.parent)
        case _:
            pass  # it is missing


# -- of lines of JSON ------------------------------------------------------------------------------------


def _lines(path: Path, rng: random.Random) -> None:
    """Removed, doubled, swapped, put in."""
    lines = path.read_bytes().splitlines(keepends=True) or [b"\n"]
    for _ in range(rng.choice((1, 3, 30))):
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(5):
            case 0:
                del lines[at : at + rng.choice((1, 1, 20, 200))]
            case 1:
                lines[at:at] = lines[at : at + rng.choice((1, 30))] * rng.choice((1, 2, 10))
            case 2:
                lines[at], lines[other] = lines[other], lines[at]
            case 3:
                lines.insert(at, rng.choice(_RAW) + b"\n")
            case _:
                lines.reverse() if rng.random() < 0.1 else rng.shuffle(lines[at : at + 9])
        lines = lines or [b"\n"]
    path.write_bytes(b"".join(lines))


def _values(path: Path, rng: random.Random) -> None:
    """Absurd values, here and there."""
    lines = path.read_bytes().splitlines()
    for _ in range(rng.choice((1, 1, 5, 50)) if lines else 0):
        at = rng.randrange(len(lines))
        row = _parsed(lines[at])
        _spoil(row, rng)
        lines[at] = json.dumps(row).encode()
    path.write_bytes(b"\n".join(lines) + b"\n")


def _everywhere(path: Path, rng: random.Random) -> None:
    """One field of one kind of row is absurd in all of them."""
    rows = [_parsed(line) for line in path.read_bytes().splitlines()]
    found = [row for row in rows if isinstance(row, dict)]
    if not found:
        return
    like = rng.choice(found)
    places = list(_places(like))
    if not places:
        return
    place, value = rng.choice(places), _absurd(rng)
    for row in found:
        if row.get("type") == like.get("type"):
            _put(row, place, value)
    path.write_bytes(b"".join(json.dumps(row).encode() + b"\n" for row in rows))


def _times(path: Path, rng: random.Random) -> None:
    """The clock: far off from somewhere on, backwards, scaled, standing."""
    change: Callable[[float], float] = rng.choice(
        (lambda t: t + 1e9, lambda t: t - 1e9, lambda t: -t, lambda t: t * 1e6, lambda t: 0.0, lambda t: t * 1e-9,
         lambda t: 1e300 - t)
    )  # fmt: skip
    lines = path.read_bytes().splitlines()
    begin = rng.choice((0, rng.randrange(len(lines) or 1)))
    end = begin + rng.choice((1, 10, len(lines)))
    for at in range(begin, min(end, len(lines))):
        row = _parsed(lines[at])
        for place in _places(row):
            value = _get(row, place)
            if str(place[-1]).endswith("t_s") or str(place[-1]).startswith("t_"):
                _put(row, place, change(value) if isinstance(value, float) else value)
        lines[at] = json.dumps(row).encode()
    path.write_bytes(b"\n".join(lines) + b"\n")


def _strings(path: Path, rng: random.Random) -> None:
    """Hostile ones in place of those that are there."""
    lines = path.read_bytes().splitlines()
    for at, line in enumerate(lines):
        row = _parsed(line)
        for place in _places(row):
            if isinstance(_get(row, place), str) and place != ("type",) and rng.random() < 0.3:
                _put(row, place, rng.choice(HOSTILE))
        lines[at] = json.dumps(row).encode()
    for _ in range(3):
        said = {"n": 0, "t_s": 101.0, "type": "Said", "frame": None, "data": {"text": rng.choice(HOSTILE)}}
        order = {"order": rng.choice(HOSTILE), "answer": rng.choice(HOSTILE), "refused": rng.random() < 0.5}
        ordered = {"n": 0, "t_s": 101.0, "type": "Ordered", "frame": None, "data": order}
        if path.name == LOG:
            lines.insert(rng.randrange(len(lines) + 1), json.dumps(rng.choice((said, ordered))).encode())
    path.write_bytes(b"\n".join(lines) + b"\n")


# -- of the manifest -------------------------------------------------------------------------------------


def _document(path: Path, rng: random.Random) -> None:
    """Absurd values in one whole document."""
    values = _parsed(path.read_bytes())
    for _ in range(rng.choice((1, 1, 4, 20))):
        if isinstance(values, dict) and rng.random() < 0.5:  # few of its many values are not of the configuration
            values[rng.choice([*values, "format"])] = _absurd(rng)
        else:
            _spoil(values, rng)
    path.write_bytes(json.dumps(values).encode())


def _document_strings(path: Path, rng: random.Random) -> None:
    values = _parsed(path.read_bytes())
    for place in list(_places(values)):
        if isinstance(_get(values, place), str) and rng.random() < (0.05 if place[0] == "config" else 0.5):
            _put(values, place, rng.choice(HOSTILE))
    if isinstance(values, dict):
        values["problems"] = [rng.choice(HOSTILE)]
    path.write_bytes(json.dumps(values).encode())


def _document_raw(path: Path, rng: random.Random) -> None:
    path.write_bytes(rng.choice((*_RAW, b'{"config":' * 50_000, b'{"config":{"a":' + b"[" * 900 + b"]" * 900 + b"}}")))


_OF: Final[dict[str, tuple[Damage, ...]]] = {
    LOG: (_lines, _values, _values, _everywhere, _everywhere, _times, _strings),
    INDEX: (_lines, _values, _values, _everywhere, _times, _strings),
    MANIFEST: (_document, _document, _document_strings, _document_raw),
}


# -- of trees of values ----------------------------------------------------------------------------------

Place = tuple[str | int, ...]


def _parsed(line: bytes) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return {}


def _places(value: Any, here: Place = ()) -> list[Place]:
    """Of every leaf."""
    keyed = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if keyed is None or len(here) > _DEEP:
        return [here] if here else []
    return [place for key, each in keyed for place in _places(each, (*here, key))]


def _get(value: Any, place: Place) -> Any:
    for key in place:
        value = value[key]
    return value


def _put(value: Any, place: Place, new: Any) -> None:
    try:
        _get(value, place[:-1])[place[-1]] = new
    except (KeyError, IndexError, TypeError):
        return  # it is of another form there


def _absurd(rng: random.Random) -> Any:
    return copy.deepcopy(rng.choice((*_ABSURD, rng.choice(HOSTILE), rng.uniform(-1e6, 1e6), rng.randrange(10**6))))


def _spoil(row: Any, rng: random.Random) -> None:
    places = _places(row)
    if not places:
        return
    place = rng.choice(places)
    place = place[: rng.randrange(1, len(place) + 1)] if rng.random() < 0.2 else place
    value, old = _absurd(rng), _get(row, place)
    if isinstance(old, float) and rng.random() < 0.5:  # of the right type, so that it is not refused at the door
        value = rng.choice((1e308, -1e308, 1e18, -1e9, 0.0, 1e-320, -old, old * 1e6))
    _put(row, place, value)
