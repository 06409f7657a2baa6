"""The report knows how the camera is mounted, and what it sees."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from control.engagement import State
from control.gimbal import GimbalLimits, GimbalState
from gcs.config import CameraConfig, Config, GimbalConfig
from gcs.recorder.manifest import Manifest, VideoFacts, plain, write_manifest
from gcs.report.make import report_of, write_report
from tests.gcs.report_rig import START_S, frame, tick, write_log

CALIBRATED = CameraConfig(hfov_deg=70.0, width_px=1280, height_px=720, fx_px=640.0)
ASIDE = CameraConfig(mount_rpy_deg=(0.0, 0.0, 90.0))
SMALL = (640, 360)
OFF_RAD = 0.1
SWINGS_RAD = (0.4, -0.4)  # so wide that the edges are near enough to be drawn


def write_flight(
    folder: Path,
    config: Config,
    *azimuths_rad: float,
    size: tuple[int, int] | None = SMALL,
    gimbal: GimbalState | None = None,
) -> Path:
    """Two seconds of following with the nose to the north; azimuths_rad: of the target, in turn."""
    entries: list[tuple[float, object]] = []
    for n in range(40):
        t_s = START_S + n * 0.05
        camera = None if gimbal is None else replace(gimbal, t_s=t_s)
        entries += [
            (t_s, replace(tick(t_s, State.FOLLOWING), camera=camera)),
            (t_s, frame(t_s, azimuths_rad[n % len(azimuths_rad)])),
        ]
    write_log(folder, entries)
    manifest = Manifest(
        kind="run", started="2026-05-03T10:00:00Z", ended="2026-05-03T10:00:02Z", t_start_s=START_S,
        unix_start_s=1.7e9, software={}, machine={}, config=plain(config),
        video=None if size is None else VideoFacts("camera", *size, 20.0),
    )  # fmt: skip
    write_manifest(folder, manifest)
    return folder


def page_of(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


def test_the_bearing_error_of_a_camera_that_looks_aside_is_taken_against_where_it_looks(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "flight", Config(camera=ASIDE), math.pi / 2 + OFF_RAD)
    assert report_of(folder).following.bearing_rms_deg == pytest.approx(math.degrees(OFF_RAD))


def test_a_gimbal_has_no_mount(tmp_path: Path) -> None:
    config = Config(camera=ASIDE, gimbal=GimbalConfig(enabled=True))
    looking = GimbalState(START_S, 0.0, 0.5, 0.5, 0.0, 0.0, START_S, GimbalLimits())
    folder = write_flight(tmp_path / "flight", config, 0.5 + OFF_RAD, gimbal=looking)
    assert report_of(folder).following.bearing_rms_deg == pytest.approx(math.degrees(OFF_RAD))
    silent = write_flight(tmp_path / "silent", config, OFF_RAD)
    assert report_of(silent).following.bearing_rms_deg == pytest.approx(math.degrees(OFF_RAD))


@pytest.mark.parametrize(
    ("camera", "right", "left"),
    [
        (CameraConfig(hfov_deg=70.0), "35", "−35"),
        (CALIBRATED, "45", "−45"),  # made at twice the size
        (replace(CALIBRATED, cx_px=320.0), "56.31", "−26.57"),  # the lens's middle is not the picture's
    ],
)
def test_the_edges_of_the_picture_are_where_the_calibration_has_them(
    camera: CameraConfig, right: str, left: str, tmp_path: Path
) -> None:
    page = page_of(write_flight(tmp_path / "flight", Config(camera=camera), *SWINGS_RAD))
    assert f"right edge of the picture {right}<" in page
    assert f"left edge {left}<" in page


def test_a_lens_that_bends_the_picture_sees_further_than_its_focal_length_says(tmp_path: Path) -> None:
    bent = replace(CALIBRATED, distortion=(-0.1, 0.0, 0.0, 0.0, 0.0))
    page = page_of(write_flight(tmp_path / "flight", Config(camera=bent), *SWINGS_RAD))
    edge = re.search(r"left edge −([0-9.]+)<", page)
    assert edge is not None
    assert 47.0 < float(edge[1]) < 55.0


@pytest.mark.parametrize("size", [None, (640, 480)])
def test_edges_that_are_not_known_are_not_drawn(size: tuple[int, int] | None, tmp_path: Path) -> None:
    page = page_of(write_flight(tmp_path / "flight", Config(camera=CALIBRATED), *SWINGS_RAD, size=size))
    assert "Bearing error" in page
    assert "left edge" not in page
