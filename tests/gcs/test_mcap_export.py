"""Flights as MCAP: every message is what its schema says, and what the flight's log says."""

from __future__ import annotations

import json
import math
import resource
import sys
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from gcs.cli import entry as cli
from gcs.errors import EXIT_USAGE
from gcs.lockstep.world import UNIX_S
from gcs.mcap_export.command import export_flight
from gcs.mcap_export.schemas import foxglove_schemas
from gcs.recorder.manifest import read_manifest
from gcs.replay.log import FlightLog, TickRow
from tests.gcs.mcap_reading import read_mcap
from tests.gcs.replay_rig import SIZE, record_flight

DRAWN = {
    "/camera/image": "foxglove.CompressedImage",
    "/camera/boxes": "foxglove.ImageAnnotations",
    "/camera/calibration": "foxglove.CameraCalibration",
    "/vehicle/location": "foxglove.LocationFix",
    "/target/location": "foxglove.LocationFix",
    "/target/pose": "foxglove.PoseInFrame",
    "/tf": "foxglove.FrameTransform",
    "/log": "foxglove.Log",
}
PLOTTED = (
    "/state", "/vehicle/state", "/target/state", "/request", "/setpoint", "/latency", "/link", "/audit", "/refusals",
    "/orders", "/selection", "/camera/frame", "/mavlink/ATTITUDE", "/mavlink/HEARTBEAT",
)  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = record_flight(tmp_path_factory.mktemp("flight"))
    export_flight(folder, folder / "flight.mcap")
    return folder


def leaves(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The schemas of all fields below."""
    for field in schema.get("properties", {}).values():
        yield field
        yield from leaves(field)
        if field.get("type") == "array":
            yield field["items"]
            yield from leaves(field["items"])


def test_every_message_keeps_to_its_schema(flight: Path) -> None:
    messages, schemas, names = read_mcap(flight / "flight.mcap")
    assert set(DRAWN) | set(PLOTTED) <= set(messages)
    for topic, found in messages.items():
        Draft202012Validator.check_schema(schemas[topic])
        validator = Draft202012Validator(schemas[topic])
        for _, message in found:
            validator.validate(message)
            assert set(message) <= set(schemas[topic]["properties"]), topic
        if names[topic].startswith("foxglove."):
            assert schemas[topic] == foxglove_schemas()[names[topic]]
    assert {topic: names[topic] for topic in DRAWN} == DRAWN


def test_schemas_are_such_as_foxglove_reads(flight: Path) -> None:
    _, schemas, _ = read_mcap(flight / "flight.mcap")
    for topic, schema in schemas.items():
        assert schema["type"] == "object"
        for field in leaves(schema):
            if "oneOf" in field:
                assert all(isinstance(each["const"], int) for each in field["oneOf"])
                continue
            assert field["type"] in ("boolean", "string", "number", "integer", "object", "array"), topic
            if field["type"] == "array":
                assert field["items"]["type"] != "array", topic


def test_it_says_what_the_log_says(flight: Path) -> None:
    messages, _, _ = read_mcap(flight / "flight.mcap")
    manifest = read_manifest(flight)
    rows = [message for _, _, message in FlightLog(flight)]
    ticks = [row for row in rows if isinstance(row, TickRow)]
    assert [message["state"] for _, message in messages["/state"]] == [row.output.state.value for row in ticks]
    sent = [row.setpoint for row in ticks if row.setpoint is not None]
    for (_, message), setpoint in zip(messages["/setpoint"], sent, strict=True):
        assert tuple(message["velocity_ned_mps"]) == setpoint.velocity_ned_mps
    for (ns, _), row in zip(messages["/state"], ticks, strict=True):
        assert abs(ns / 1e9 - manifest.unix_s(row.t_s)) < 1e-6
    assert messages["/state"][0][0] / 1e9 > UNIX_S - 1.0
    said = [(message["name"], message["message"]) for _, message in messages["/log"]]
    assert ("state", "FOLLOWING") in said
    assert any(name == "operator" and text.startswith("abort") for name, text in said)


def test_a_box_lies_on_its_picture(flight: Path) -> None:
    """The red rectangle in the film is where Foxglove draws the box, for it takes both by their equal times."""
    messages, _, _ = read_mcap(flight / "flight.mcap")
    pictures = {tuple(message["timestamp"].values()): message for _, message in messages["/camera/image"]}
    looked_at = 0
    for _, drawn in messages["/camera/boxes"]:
        picture = pictures[tuple(drawn["timestamp"].values())]
        if not drawn["texts"]:
            continue
        corners = drawn["points"][-1]["points"]
        image = cv2.imdecode(np.frombuffer(b64decode(picture["data"]), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert (image.shape[1], image.shape[0]) == SIZE
        u, v = (round(sum(corner[axis] for corner in corners) / 4) for axis in ("x", "y"))
        if drawn["points"][-1]["outline_color"]["g"] == 0.9 and 0 < u < SIZE[0] and 0 < v < SIZE[1]:
            blue, _, red = (int(value) for value in image[v, u])
            assert red > blue + 60
            looked_at += 1
    assert looked_at > 20


def test_the_target_is_where_the_camera_looks(flight: Path) -> None:
    """Through the transform and the calibration, the target's place falls into its box: all signs are right."""
    messages, _, _ = read_mcap(flight / "flight.mcap")
    camera = {ns: message for ns, message in messages["/tf"] if message["child_frame_id"] == "camera"}
    k = messages["/camera/calibration"][0][1]["K"]
    states = dict(messages["/target/state"])
    looked_at = 0
    for ns, message in messages["/target/pose"]:
        x, y, z = in_camera(camera[ns], message["pose"]["position"])
        u, v = k[0] * x / z + k[2], k[4] * y / z + k[5]
        assert z > 0
        boxes = [frame["box"] for at, frame in messages["/camera/frame"] if "box" in frame and abs(at - ns) < 2e8]
        assert states[ns]["confidence"] >= 0
        if boxes:
            nearest = min(boxes, key=lambda box: math.hypot(box["cx_px"] - u, box["cy_px"] - v))
            assert math.hypot(nearest["cx_px"] - u, nearest["cy_px"] - v) < 40, (u, v, nearest)
            looked_at += 1
    assert looked_at > 20


def in_camera(transform: dict[str, Any], position: dict[str, float]) -> tuple[float, float, float]:
    """A place of the parent frame in the child's axes."""
    q, t = transform["rotation"], transform["translation"]
    w, axis = q["w"], np.array([q["x"], q["y"], q["z"]])
    away = np.array([position[name] - t[name] for name in "xyz"])
    turned = away + 2 * np.cross(-axis, np.cross(-axis, away) + w * away)
    return float(turned[0]), float(turned[1]), float(turned[2])


def test_the_manifest_is_in_it(flight: Path) -> None:
    with (flight / "flight.mcap").open("rb") as file:
        reader = make_reader(file)
        (attached,) = reader.iter_attachments()
        (facts,) = reader.iter_metadata()
        summary = reader.get_summary()
    assert attached.data == (flight / "manifest.json").read_bytes()
    assert facts.metadata["kind"] == "run"
    assert summary is not None
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}


def test_a_flight_without_film_and_manifest_is_exported_too(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = (flight / "messages.jsonl").read_bytes()[:400_003]  # in the middle of a line
    (tmp_path / "messages.jsonl").write_bytes(cut)
    assert cli.main(["export", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["notes"]) == 2
    messages, _, _ = read_mcap(tmp_path / "flight.mcap")
    assert {topic: len(found) for topic, found in messages.items()} == told["topics"]
    assert "/camera/image" not in messages
    assert "/setpoint" in messages


def test_what_cannot_be_is_one_line(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    for argv, words in (
        (["export", str(tmp_path / "none")], "no such flight"),
        (["export", str(empty)], "messages.jsonl"),
        (["export", str(flight), "--mcap", str(tmp_path / "no" / "where.mcap")], "where.mcap: no such file"),
        (["export", str(flight), "--mcap", "/dev/null"], "must end in .mcap"),
        (["export", str(flight), "--mcap", str(empty)], "must end in .mcap"),
    ):
        assert cli.main(argv) == EXIT_USAGE
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    assert list(tmp_path.iterdir()) == [empty]


def test_a_full_disk_is_one_line_and_leaves_nothing(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
    try:
        assert cli.main(["export", str(flight), "--mcap", str(tmp_path / "flight.mcap")]) == EXIT_USAGE
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    (line,) = capsys.readouterr().err.splitlines()
    assert "flight.mcap: file too large" in line
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_it_says_what_to_install(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert cli.main(["export", str(flight), "--mcap", str(tmp_path / "flight.mcap")]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install 'climrt-gcs[mcap]'" in line
    assert list(tmp_path.iterdir()) == []
