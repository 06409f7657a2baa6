from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from control.config import ControlConfig
from gcs.config import CameraConfig, Config, FollowChoice, Latent, load
from gcs.config_example import render
from gcs.errors import ConfigError

EXAMPLE = Path(__file__).parents[2] / "docs" / "example.yaml"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return path


def test_no_file_is_needed() -> None:
    assert load(None) == Config()
    assert load(None).control == ControlConfig()


def test_the_example_holds_every_key_with_its_default() -> None:
    assert load(EXAMPLE) == Config()
    assert EXAMPLE.read_text() == render(), "defaults changed: gcs config > docs/example.yaml"

    def same_keys(node: Any, values: Any) -> None:
        assert set(node) == {f.name for f in fields(values)}
        for f in fields(values):
            if is_dataclass(getattr(values, f.name)):
                same_keys(node[f.name], getattr(values, f.name))

    same_keys(yaml.safe_load(EXAMPLE.read_text()), Config())


def test_values_arrive_where_they_belong(tmp_path: Path) -> None:
    text = """
camera:
  hfov_deg: 60
  mount_rpy_deg: [0, -20, 0]
  glass_delay_s: 0.12
tracker: {latent: off, threads: 2}
follow:
  mode: spotlight
control:
  follow:
    max_speed_mps: 4
  limits:
    fence:
      radius_m: 50
      polygon_deg: [[47.0, 8.0], [47.001, 8], [47.0, 8.001]]
recorder:
"""
    config = load(written(tmp_path, text))
    assert config.tracker.latent is Latent.OFF
    assert config.follow.mode is FollowChoice.SPOTLIGHT
    assert config.control.follow.max_speed_mps == 4
    assert config.control.limits.fence.radius_m == 50
    assert config.control.limits.fence.polygon_deg[1] == (47.001, 8.0)
    camera = config.camera.model(1280, 720)
    assert camera.fx_px == pytest.approx(640 / math.tan(math.radians(30)))
    assert camera.mount_rpy_rad == pytest.approx((0, math.radians(-20), 0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera:\n  hfow_deg: 60\n", "c.yaml:2: camera.hfow_deg: unknown key (did you mean hfov_deg?)"),
        ("\n\nwings: 2\n", "c.yaml:3: wings: unknown key"),
        ("camera:\n  hfov_deg: 200\n", "c.yaml:2: camera.hfov_deg: must be from 5 to 170, not 200"),
        ("camera:\n  hfov_deg: wide\n", "c.yaml:2: camera.hfov_deg: expected float, got str"),
        ("camera:\n  hfov_deg: .nan\n", "c.yaml:2: camera.hfov_deg: must be a finite number"),
        ("camera:\n  hfov_deg: true\n", "c.yaml:2: camera.hfov_deg: expected float, got bool"),
        ("camera:\n  mount_rpy_deg: [0, 0]\n", "c.yaml:2: camera.mount_rpy_deg: expected array of length 3"),
        ("camera:\n  mount_rpy_deg: [0, .inf, 0]\n", "c.yaml:2: camera.mount_rpy_deg: must be a finite number"),
        ("camera:\n  hfov_deg: 60\n  hfov_deg: 61\n", "c.yaml:3: camera.hfov_deg: given twice"),
        ("tracker:\n  threads: 2.5\n", "c.yaml:2: tracker.threads: expected int"),
        ("tracker:\n  graphs: out\n", "tracker: graphs needs engine openvino or onnxruntime"),
        ("tracker:\n  latent: dream\n", "(known: climnet, previous, off)"),
        ("tracker:\n  weights: {a: 1}\n", "c.yaml:2: tracker.weights: must be a single value"),
        ("vehicle: fast\n", "c.yaml:1: vehicle: must be a list of `key: value` lines"),
        (
            "control:\n  limits:\n    max_speed_mps: 50\n",
            "c.yaml:3: control.limits.max_speed_mps: must be from 0.1 to 12",
        ),
        ("control:\n  engagement:\n    max_rejections: 99\n", "c.yaml:3: control.engagement.max_rejections: must be"),
        (
            "control:\n  limits:\n    fence:\n      min_height_m: 70\n",
            "c.yaml:4: control.limits.fence: min_height_m 70 must be",
        ),
        ("control:\n  follow:\n    max_speed_mps: 9\n", "control: follow.max_speed_mps 9 is above the gate's limit"),
        ("camera:\n  fx_px: 900\n", "c.yaml:2: camera: fx_px needs width_px"),
        ("a: [1,\n", "not valid YAML"),
        ("a: \x07\n", "not valid YAML"),
        ("a: &x 1\nb: *x\n", "c.yaml:2: YAML aliases"),
        ("vehicle:\n  timeout_s: !!int ''\n", "c.yaml:2: vehicle.timeout_s: is not a value"),
        ("vehicle:\n  timeout_s: !!bool x\n", "c.yaml:2: vehicle.timeout_s: is not a value"),
        ("vehicle:\n  timeout_s: !!timestamp x\n", "c.yaml:2: vehicle.timeout_s: is not a value"),
        ("video:\n " + "[" * 200_000, "c.yaml:2: nested more than 16 deep"),
        ("[1, 2]\n", "c.yaml:1: the file: must be a list"),
        ("vehicle:\n  url: !!python/object:os.system {}\n", "c.yaml:2: vehicle.url: must be a single value"),
        ("vehicle:\n  url: !!python/name:os.system\n", "c.yaml:2: vehicle.url: is not a value"),
    ],
)
def test_each_fault_is_one_line_with_file_line_and_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load(tmp_path / "none.yaml")
    with pytest.raises(ConfigError, match="is a directory"):
        load(tmp_path)
    (tmp_path / "c.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load(tmp_path / "c.yaml")
    (tmp_path / "c.yaml").write_bytes(b"#" * 300_000)
    with pytest.raises(ConfigError, match="too many"):
        load(tmp_path / "c.yaml")
    assert load(written(tmp_path, "# nothing but a comment\n")) == Config()


def test_a_calibration_is_scaled_to_the_video() -> None:
    config = CameraConfig(width_px=1280, height_px=720, fx_px=900.0, cx_px=650.0)
    camera = config.model(640, 360)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (450.0, 450.0, 325.0, 180.0)
    with pytest.raises(ConfigError, match="calibrated at 1280x720 px, but the video is 640x480 px"):
        config.model(640, 480)


YAML_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
SECTIONS = st.sampled_from([f.name for f in fields(Config)])


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(SECTIONS | st.text(max_size=4), YAML_VALUES, max_size=4))
def test_whatever_the_file_holds_the_answer_is_a_config_or_one_line(tmp_path: Path, values: dict[str, Any]) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(values), encoding="utf-8")
    answer: Config | str
    try:
        answer = load(path)
    except ConfigError as error:
        answer = str(error)
    assert isinstance(answer, Config) or len(answer.splitlines()) == 1
