from __future__ import annotations

import argparse
import base64
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from control.engagement import State
from gcs.errors import GcsError
from gcs.recorder.events import Ordered, Received, Refusals, Said
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.manifest import MANIFEST, read_manifest, write_manifest
from gcs.report.make import ReportError, main, report_of, write_report
from gcs.report.pictures import WIDTH_PX, window
from tests.gcs.replay_rig import record_flight
from tests.gcs.report_rig import START_S, frame, status_text, ticks, vehicle_frames, write_log
from tracker.box import Box

SECTIONS = (
    "timeline", "above", "curves", "moments", "limits", "latency", "link", "operator", "parameters", "record",
)  # fmt: skip
HOSTILE = "<img src=x onerror=alert(1)>"
LOADS = {"src", "href", "xlink:href", "data", "action", "srcset", "poster"}


class Looked(HTMLParser):
    """What a page has in it."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: set[str] = set()
        self.loads: list[str] = []
        self.words: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            assert not name.startswith("on"), f"<{tag} {name}>"
            if name == "id" and value is not None:
                assert value not in self.ids, f"{value} is there twice"
                self.ids.add(value)
            if name in LOADS:
                self.loads.append(value or "")

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("recorded"))


@pytest.fixture
def flown(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "flown"))


def looked(folder: Path) -> Looked:
    return Looked(write_report(folder).read_text(encoding="utf-8"))


def arguments(folder: Path, html: Path | None = None, json: bool = False) -> argparse.Namespace:
    return argparse.Namespace(flight=str(folder), html=None if html is None else str(html), json=json)


def test_a_page_has_every_section_and_loads_nothing(flown: Path) -> None:
    page = looked(flown)
    assert set(SECTIONS) <= page.ids
    assert "script" not in page.tags
    assert "link" not in page.tags
    for load in page.loads:
        assert load.startswith(("#", "data:image/jpeg;base64,")), load[:80]
    for load in page.loads:
        assert not load.startswith("#") or load[1:] in page.ids, load


def test_a_loss_is_shown_as_last_seen_lost_and_found_again(flown: Path) -> None:
    page = write_report(flown).read_text(encoding="utf-8")
    card = page[page.index('id="loss-1"') : page.index('id="limits"')]
    shots = re.findall(r"base64,([^\"]+)\".*?<figcaption>([^<]+)</figcaption>", card)
    assert [re.sub(r", .*", "", name) for _, name in shots] == ["last seen", "lost", "found again"]
    red = []
    for data, _ in shots:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape[1] == WIDTH_PX
        blue, green, part = (image[..., n].astype(int) for n in range(3))
        red.append(int(((part > 150) & (green < 90) & (blue < 90)).sum()))
    assert red[0] > 200  # the target of the rig
    assert red[1] < 20
    assert red[2] > 200


def test_what_comes_from_a_flight_is_text_and_nothing_else(tmp_path: Path) -> None:
    name = "<script>alert(2)</script>"
    entries = [
        (START_S, Refusals((HOSTILE,))),
        *ticks(0.0, 0.5, State.FOLLOWING),
        (START_S + 0.1, Said(HOSTILE)),
        (START_S + 0.2, Ordered(name, HOSTILE, True)),
        (START_S + 0.3, Received(status_text(HOSTILE))),
        (START_S + 0.4, frame(START_S + 0.4, None, problem=HOSTILE)),
    ]
    folder = write_log(tmp_path / "<b>flight", entries)
    page = looked(folder)
    assert "img" not in page.tags
    assert "script" not in page.tags
    assert "b" in page.tags  # the tiles have it, the folder's name must not add to it
    words = "".join(page.words)
    assert words.count(HOSTILE) >= 5
    assert name in words
    assert "<b>flight" in words


def test_the_manifest_tells_software_weights_and_what_was_configured(flown: Path) -> None:
    manifest = read_manifest(flown)
    config = {**manifest.config, "page": {**manifest.config["page"], "token": "a-secret-token"}}
    config["video"] = {**config["video"], "url": "rtsp://me:password@camera/main"}
    text = manifest.__class__(
        **{
            **{name: getattr(manifest, name) for name in manifest.__struct_fields__},
            "config": config, "software": {"climrt-gcs": "9.9.9"}, "machine": {"cpu": "a processor"},
        }
    )  # fmt: skip
    write_manifest(flown, text)
    page = write_report(flown).read_text(encoding="utf-8")
    assert "flight · simulated · " not in page
    for wanted in ("9.9.9", "a processor", "page.token", "(secret)", "video.url"):
        assert wanted in page
    for unwanted in ("a-secret-token", "password"):
        assert unwanted not in page


def test_a_simulated_vehicle_is_said_to_be_one(flown: Path) -> None:
    manifest = read_manifest(flown)
    manifest.config["vehicle"]["simulated"] = True
    write_manifest(flown, manifest)
    assert "flight · simulated · " in write_report(flown).read_text(encoding="utf-8")


@pytest.mark.parametrize("missing", [MANIFEST, "film.mjpeg", "film.jsonl"])
def test_a_flight_is_told_without_its_other_files(flown: Path, missing: str) -> None:
    (flown / missing).unlink()
    page = looked(flown)
    assert set(SECTIONS) <= page.ids
    words = "".join(page.words)
    assert "manifest" in words if missing == MANIFEST else "There are no pictures" in words


@pytest.mark.parametrize("left", [0.1, 0.5, 0.9])
def test_a_flight_that_was_broken_off_is_told_up_to_there(flown: Path, left: float) -> None:
    data = (flown / MESSAGES).read_bytes()
    (flown / MESSAGES).write_bytes(data[: round(len(data) * left)])
    page = looked(flown)
    assert set(SECTIONS) <= page.ids
    assert "cut off" in "".join(page.words)


def test_a_damaged_manifest_is_a_line_of_the_report(flown: Path) -> None:
    (flown / MANIFEST).write_bytes(b"{ not json")
    assert any("not a manifest" in said for said in report_of(flown).problems)
    assert set(SECTIONS) <= looked(flown).ids


def test_a_log_from_elsewhere_makes_a_page(tmp_path: Path) -> None:
    entries = [(t_s, Received(data)) for t_s, data in vehicle_frames(20.0)]
    page = looked(write_log(tmp_path / "flight", entries))
    words = "".join(page.words)
    assert "LOITER, armed" in words
    assert "Nothing was followed." in words
    assert "first position" in words


def test_the_command_writes_the_page_where_it_is_told(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(flown)) == 0
    assert str(flown / "report.html") in capsys.readouterr().out
    assert main(arguments(flown, tmp_path / "other.html")) == 0
    assert (tmp_path / "other.html").read_bytes() == (flown / "report.html").read_bytes()
    (flown / "report.html").unlink()
    assert main(arguments(flown, json=True)) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["losses"][0]["found"] is True
    assert not (flown / "report.html").exists()


def test_what_cannot_be_reported_is_one_clear_line(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(GcsError, match="no such flight"):
        main(arguments(tmp_path / "nowhere"))
    with pytest.raises(ReportError, match="no/such/place"):
        write_report(flown, tmp_path / "no/such/place.html")
    (tmp_path / "empty").mkdir()
    with pytest.raises(GcsError, match="no such file"):
        write_report(tmp_path / "empty")
    (flown / MESSAGES).write_bytes(b"")
    with pytest.raises(GcsError, match="no flight in it"):
        write_report(flown)


def test_a_picture_is_cut_out_round_its_target() -> None:
    assert window(1920, 1080, None) == (0, 0, 1920, 1080)
    assert window(1920, 1080, Box(960, 540, 40, 30)) == (480, 270, 960, 540)
    assert window(1920, 1080, Box(5, 1075, 40, 30)) == (0, 540, 960, 540)
    assert window(1920, 1080, Box(960, 540, 400, 300)) == (0, 0, 1920, 1080)
    assert window(200, 100, Box(100, 50, 4, 4)) == (0, 0, 200, 100)
