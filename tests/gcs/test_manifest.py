"""What a flight was flown with is told whole, reads back, and holds no secret."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from gcs.clock import FakeClock
from gcs.config import Config, VehicleConfig, VideoConfig
from gcs.operator.config import PageConfig
from gcs.recorder import facts
from gcs.recorder.manifest import MANIFEST, ManifestError, read_manifest, write_manifest
from tests.gcs.blob_tracker import BlobTracker
from tracker.weights import DATA, load_tracker


def test_it_reads_back_as_it_was_written(tmp_path: Path) -> None:
    manifest = facts.gather("run", Config(), FakeClock(12.5), vehicle="udpin://0.0.0.0:14540", seed=3, watermark="SIM")
    write_manifest(tmp_path, manifest)
    assert [path.name for path in tmp_path.iterdir()] == [MANIFEST]
    again = read_manifest(tmp_path)
    assert msgspec.structs.replace(again, config={}) == msgspec.structs.replace(manifest, config={})
    assert again.configuration == Config()
    assert (again.kind, again.seed, again.watermark, again.t_start_s) == ("run", 3, "SIM", 12.5)
    assert again.unix_s(13.5) == again.unix_start_s + 1.0
    assert again.ended is None
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", again.started)
    assert {"python", "numpy", "torch", "mavsdk", "code"} <= again.software.keys()
    assert int(again.machine["cores"]) >= 1


def test_no_secret_gets_in(tmp_path: Path) -> None:
    config = replace(
        Config(),
        page=PageConfig(token="a-page-token-of-mine"),
        video=VideoConfig(url="rtsp://me:word@10.0.0.2/live?password=word2"),
        vehicle=VehicleConfig(url="tcpout://me:word3@10.0.0.2:5760"),
    )
    write_manifest(tmp_path, facts.gather("run", config, FakeClock(), vehicle=config.vehicle.url))
    text = (tmp_path / MANIFEST).read_text()
    assert "a-page-token" not in text
    assert "word" not in text.replace("password=", "")
    assert read_manifest(tmp_path).configuration.page == PageConfig()


def test_it_names_the_weights_and_threads_of_a_real_tracker_only() -> None:
    import torch

    found = facts.weights_of(load_tracker("compact"))
    assert found is not None
    assert found.sha256 == json.loads((DATA / "compact.json").read_text())["sha256"]
    assert (found.threads, found.engine, found.latent) == (torch.get_num_threads(), "torch", "previous")
    assert facts.pytorch_facts()["torch_cpu"]
    assert facts.weights_of(BlobTracker()) is None


def test_it_needs_no_pytorch() -> None:
    code = (
        "import sys; from gcs.recorder import facts; from gcs.clock import FakeClock; from gcs.config import Config; "
        "facts.gather('run', Config(), FakeClock()); assert 'torch' not in sys.modules and facts.pytorch_facts() == {}"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no such file or directory"),
        (b"", "not a manifest: Input data was truncated"),
        (b"\xff\xfe{}", "not a manifest"),
        (b"[]", "not a manifest: Expected `object`, got `array`"),
        (b'{"kind": 3}', "not a manifest: "),
    ],
)
def test_a_manifest_that_is_none_is_one_line(tmp_path: Path, text: bytes | None, said: str) -> None:
    if text is not None:
        (tmp_path / MANIFEST).write_bytes(text)
    with pytest.raises(ManifestError) as caught:
        read_manifest(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / MANIFEST}: {said}")
    assert "\n" not in str(caught.value)


def test_another_format_and_another_configuration_are_said(tmp_path: Path) -> None:
    manifest = facts.gather("run", Config(), FakeClock())
    write_manifest(tmp_path, msgspec.structs.replace(manifest, format=99))
    with pytest.raises(ManifestError, match="format 99; this version reads 1"):
        read_manifest(tmp_path)
    other = msgspec.structs.replace(manifest, config={**manifest.config, "tracker": {"threads": "many"}})
    with pytest.raises(ManifestError, match="its configuration is not of this version"):
        _ = other.configuration


def test_both_clocks_are_read_at_one_moment() -> None:
    class Slow(FakeClock):
        def now_s(self) -> float:
            return self.advance(0.25)

    t_s, _ = facts.origin(Slow(10.0))
    assert (t_s - 10.0) % 0.5 == pytest.approx(0.375)  # between two readings
