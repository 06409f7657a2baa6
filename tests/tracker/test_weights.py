from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.tracker.conftest import TINY, random_network
from tracker import weights
from tracker.box import Box
from tracker.configs import COMPACT, ConfigError, LatentProvider, TrackerConfig
from tracker.network.climrt import ClimRT
from tracker.weights import WeightsError, find_weights, load_network, load_parts, load_tracker, read_manifest, save

TRACKER = TrackerConfig(latent=LatentProvider.CLIMNET, penalty_k=0.1)


@pytest.fixture
def saved(tiny: ClimRT, tmp_path: Path) -> Path:
    return save(tmp_path / "tiny.safetensors", tiny, {"seed": 7, "credits": ["a", "b"]}, tracker=TRACKER)


def test_round_trip(tiny: ClimRT, saved: Path) -> None:
    manifest = read_manifest(saved)
    assert (manifest.network, manifest.tracker) == (TINY, TRACKER)
    assert manifest.extra["seed"] == 7
    loaded = load_network(saved)
    assert not loaded.training
    for key, value in tiny.state_dict().items():
        if "num_batches" not in key:
            torch.testing.assert_close(loaded.state_dict()[key], value, rtol=0, atol=0)
    assert list(saved.parent.glob("*.part")) == []


def test_half_precision_kernels(tiny: ClimRT, tmp_path: Path) -> None:
    whole = save(tmp_path / "whole.safetensors", tiny)
    half = save(tmp_path / "half.safetensors", tiny, half=True)
    assert half.stat().st_size < 0.65 * whole.stat().st_size
    loaded = load_network(half).state_dict()
    for key, value in tiny.state_dict().items():
        if "num_batches" not in key:
            assert loaded[key].dtype == torch.float32
            torch.testing.assert_close(loaded[key], value, rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(
        loaded["backbone.layer1.1.running_var"], tiny.state_dict()["backbone.layer1.1.running_var"]
    )


def test_load_tracker_by_path_and_by_name(
    saved: Path, monkeypatch: pytest.MonkeyPatch, frame_and_box: tuple[object, Box]
) -> None:
    assert load_tracker(saved).config == TRACKER
    monkeypatch.setattr(weights, "DATA", saved.parent)
    tracker = load_tracker("tiny", latent=LatentProvider.OFF)
    assert tracker.config == replace(TRACKER, latent=LatentProvider.OFF)
    image, box = frame_and_box
    tracker.init(image, box)  # type: ignore[arg-type]
    assert tracker.update(image).box.is_valid  # type: ignore[arg-type]
    with pytest.raises(WeightsError, match=r"^huge: no shipped weights of that name \(there are: tiny\)$"):
        load_tracker("huge")


@pytest.fixture
def frame_and_box() -> tuple[object, Box]:
    return torch.zeros(100, 100, 3, dtype=torch.uint8).numpy(), Box(50, 50, 20, 20)


def test_a_folder_of_the_same_name_hides_nothing_that_ships(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "compact").mkdir()
    assert find_weights("compact").name == "compact.safetensors"


def test_network_without_climnet(tmp_path: Path) -> None:
    path = save(tmp_path / "bare.safetensors", random_network(replace(TINY, climnet=None)))
    assert load_network(path).internet is None
    with pytest.raises(ConfigError, match="hold no ClimNet"):
        load_tracker(path, latent=LatentProvider.CLIMNET)


def damage(path: Path, how: str) -> None:
    data = bytearray(path.read_bytes())
    manifest = path.with_suffix(".json")
    match how:
        case "gone":
            path.unlink()
        case "truncated":
            path.write_bytes(data[: len(data) // 2])
        case "bit flipped":
            data[-5] ^= 1
            path.write_bytes(data)
        case "no manifest":
            manifest.unlink()
        case "manifest is not JSON":
            manifest.write_text("{")
        case "manifest of something else":
            manifest.write_text('{"format": "other/3"}')
        case "manifest without network":
            values = json.loads(manifest.read_text())
            del values["network"]
            manifest.write_text(json.dumps(values))
        case "another network":
            rewrite(manifest, network=replace(TINY, hidden=32).to_dict())
        case "network of another kind":
            rewrite(manifest, network=TINY.to_dict() | {"hidden": [1]})
        case "network of any size":
            rewrite(manifest, network=TINY.to_dict() | {"ffn": 1 << 40})
        case "parts that are no names":
            rewrite(manifest, parts=["backbone", None])
        case "not safetensors":
            path.write_bytes(pickle.dumps({"a": 1}))
            rewrite(manifest, sha256=weights._sha256(path))
        case _:
            raise AssertionError(how)


def rewrite(manifest: Path, **changes: object) -> None:
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | changes))


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("gone", "no such weights file"),
        ("truncated", "sha256"),
        ("bit flipped", "sha256"),
        ("no manifest", "manifest tiny.json is missing"),
        ("manifest is not JSON", "cannot be read as JSON"),
        ("manifest of something else", "is not a climrt-weights/1 manifest"),
        ("manifest without network", "incomplete"),
        ("another network", "of another shape"),
        ("network of another kind", "malformed"),
        ("network of any size", "must be sane"),
        ("parts that are no names", "malformed"),
        ("not safetensors", "cannot be read as safetensors"),
    ],
)
def test_damaged_files_are_named_in_one_line(saved: Path, how: str, reason: str) -> None:
    load_network(saved)  # sound before
    damage(saved, how)
    with pytest.raises(WeightsError, match=reason) as caught:
        load_tracker(saved)
    message = str(caught.value)
    assert "tiny" in message
    assert "\n" not in message


def test_missing_and_unexpected_tensors_are_named(tiny: ClimRT, tmp_path: Path) -> None:
    tensors = dict(tiny.state_dict())
    del tensors["grader.cls2.bias"]
    tensors["grader.cls3.bias"] = torch.zeros(1)
    path = weights.save_tensors(tmp_path / "odd.safetensors", tensors, TINY)
    wanted = r"1 missing \(grader\.cls2\.bias\); 1 unexpected \(grader\.cls3\.bias\)$"
    with pytest.raises(WeightsError, match=wanted):
        load_network(path)


def test_partial_weights_load_into_a_network(tiny: ClimRT, tmp_path: Path) -> None:
    tensors = {k: v for k, v in tiny.state_dict().items() if k.startswith("backbone.")}
    path = weights.save_tensors(tmp_path / "part.safetensors", tensors, TINY, parts=("backbone",))
    with pytest.raises(WeightsError, match="holds only backbone, not a whole network"):
        load_network(path)
    other = random_network(seed=5)
    heads = other.grader.cls2.weight.clone()
    assert load_parts(path, other) == ("backbone",)
    torch.testing.assert_close(other.backbone.layer5[0].weight, tiny.backbone.layer5[0].weight)
    torch.testing.assert_close(other.grader.cls2.weight, heads)


def test_compact_fits_the_repository() -> None:
    with torch.device("meta"):
        assert sum(p.numel() for p in ClimRT(COMPACT).parameters()) < 5_000_000
