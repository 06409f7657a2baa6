"""Exported graphs, the engines that run them, their files and their 8-bit form, on a network as narrow as it goes."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.tracker.conftest import TINY, random_network
from tracker.configs import TrackerConfig, Variant
from tracker.engines.correlations import without_correlations
from tracker.engines.eager import EagerEngine
from tracker.engines.engine import EngineError, Patch
from tracker.engines.export import SEARCH_PX, Graphs, export
from tracker.engines.export_files import MANIFEST, read_graphs, write_graphs
from tracker.engines.exported import ExportedEngine
from tracker.engines.onnxruntime import ONNXRuntimeEngine
from tracker.engines.openvino import OpenVINOEngine, as_ir
from tracker.engines.quantise import Calibration, quantised
from tracker.engines.quantise_frames import search_patches
from tracker.eval.sequences import Sequence
from tracker.network.climrt import ClimRT

ENGINES = [OpenVINOEngine, ONNXRuntimeEngine]
each_engine = pytest.mark.parametrize("engine_type", ENGINES, ids=lambda engine: engine.runtime)


@pytest.fixture(scope="module")
def graphs(tiny: ClimRT) -> Graphs:
    return export(tiny)


@cache
def variant_of_tiny(variant: Variant) -> tuple[EagerEngine, Graphs]:
    network = random_network(TINY.as_variant(variant))
    return EagerEngine(network), export(network)


def noise(side_px: int, seed: int = 0) -> Patch:
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, (1, side_px, side_px, 3), dtype=torch.uint8, generator=generator)


def needed(engine_type: type[ExportedEngine]) -> type[ExportedEngine]:
    if importlib.util.find_spec(engine_type.runtime) is None:
        pytest.skip(f"{engine_type.runtime} is not installed")
    return engine_type


def test_correlations_are_found_and_left_out(graphs: Graphs) -> None:
    pytest.importorskip("onnx")
    rest, found = without_correlations(graphs.compare)
    assert [(each.search, each.template) for each in found] == [
        ("search_layer4", "template_layer4"),
        ("search_layer5", "template_layer5"),
        ("latent_layer5", "template_layer5"),
    ]
    assert len(rest) < len(graphs.compare)
    embed = graphs.embed[SEARCH_PX]
    assert without_correlations(embed) == (embed, ())


@each_engine
@pytest.mark.parametrize("variant", [Variant.FULL, Variant.HIFT, Variant.CLIMNET_HIFT])
def test_every_variant_answers_as_the_reference(engine_type: type[ExportedEngine], variant: Variant) -> None:
    reference, exported = variant_of_tiny(variant)
    engine = needed(engine_type)(exported, threads=1)
    assert (engine.name, engine.has_climnet) == (engine_type.runtime, reference.has_climnet)
    template, search = reference.embed(noise(127)), reference.embed(noise(287))
    for found, wanted in zip((*engine.embed(noise(127)), *engine.embed(noise(287))), (*template, *search), strict=True):
        torch.testing.assert_close(found, wanted.contiguous(), rtol=0, atol=1e-4 * float(wanted.std()))
    wanted_maps = reference.compare(search, template, search[-1])
    for found, wanted in zip(engine.compare(search, template, search[-1]), wanted_maps, strict=True):
        torch.testing.assert_close(found, wanted.contiguous(), rtol=0, atol=1e-4)
    if engine.has_climnet:
        wanted = reference.imagine(noise(287), noise(287, 1))
        found = engine.imagine(noise(287), noise(287, 1))
        assert float((found - wanted).square().mean().sqrt()) <= 1e-2 * float(wanted.std())


@each_engine
def test_without_climnet_it_is_not_even_exported(engine_type: type[ExportedEngine], tiny: ClimRT) -> None:
    assert export(tiny, climnet=False).between is None
    assert not needed(engine_type)(tiny, threads=1, climnet=False).has_climnet


@each_engine
def test_misuse_is_one_line(engine_type: type[ExportedEngine], graphs: Graphs) -> None:
    name = needed(engine_type).runtime
    with pytest.raises(EngineError, match=f"engine {name}: threads 0: must be 1 or more"):
        engine_type(graphs, threads=0)
    with pytest.raises(EngineError, match=f"engine {name}: a patch of 64 px: its graphs are for 127 and 287 px"):
        engine_type(graphs, threads=1).embed(noise(64))
    with pytest.raises(EngineError, match=f"^engine {name}: cannot run the graph embed-127: [^\n]+$"):
        engine_type(Graphs(graphs.network, {127: b"no graph"}, graphs.compare, None), threads=1)


@each_engine
def test_a_missing_package_is_one_line(engine_type: type[ExportedEngine], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, engine_type.runtime, None)
    extra = {"openvino": "openvino", "onnxruntime": "onnx"}[engine_type.runtime]
    with pytest.raises(EngineError, match=rf"package {engine_type.runtime} is not installed: pip .*-gcs\[{extra}\]'$"):
        engine_type(random_network(), threads=1)


@each_engine
def test_a_package_that_is_broken_is_one_line(
    engine_type: type[ExportedEngine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"{engine_type.runtime}.py").write_text("raise TypeError('protobuf of\\nanother age')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, engine_type.runtime, raising=False)
    with pytest.raises(EngineError, match=rf"package {engine_type.runtime} cannot be used: another age$"):
        engine_type(random_network(), threads=1)


def test_the_reader_of_graphs_is_as_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    needed(ONNXRuntimeEngine)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(EngineError, match=r"package onnx is not installed: pip .*-gcs\[onnx\]'$"):
        ONNXRuntimeEngine(random_network(), threads=1)


@each_engine
def test_from_files(engine_type: type[ExportedEngine], graphs: Graphs, tmp_path: Path) -> None:
    written = write_graphs(tmp_path, graphs, {"weights": "tiny"})
    assert json.loads(written.read_text())["weights"] == "tiny"
    assert read_graphs(tmp_path) == graphs
    from_files = needed(engine_type).from_files(tmp_path, threads=1)
    for found, wanted in zip(
        from_files.embed(noise(127)), engine_type(graphs, threads=1).embed(noise(127)), strict=True
    ):
        torch.testing.assert_close(found, wanted, rtol=0, atol=0)


def test_damaged_files_are_one_line(graphs: Graphs, tmp_path: Path) -> None:
    def refused(pattern: str) -> None:
        with pytest.raises(EngineError, match=f"^[^\n]*{pattern}[^\n]*$"):
            read_graphs(tmp_path)

    refused("no exported graphs there")
    manifest = write_graphs(tmp_path, graphs)
    whole = manifest.read_text()
    (tmp_path / "compare.onnx").write_bytes(graphs.compare[:-1])
    refused("compare.onnx: sha256 is not the manifest's")
    (tmp_path / "compare.onnx").unlink()
    refused("compare.onnx: no such file")
    (tmp_path / "compare.onnx").write_bytes(graphs.compare)
    for broken, pattern in (
        ("{", "malformed"),
        ("[]", "is not a climrt-graphs/1 manifest"),
        (whole.replace('"f32"', '"f8"'), "precision 'f8'"),
        (whole.replace("embed-127.onnx", "embed-x.onnx"), "embed-x.onnx"),
        (whole.replace("compare.onnx", "../compare.onnx"), "must be a file in the manifest's own folder"),
    ):
        manifest.write_text(broken)
        refused(pattern)


def test_openvino_form_is_whole_and_not_taken_for_onnx(graphs: Graphs, tmp_path: Path) -> None:
    openvino = needed(OpenVINOEngine).imported()
    for name, content in as_ir({"embed-127.onnx": graphs.embed[127]}).items():
        (tmp_path / name).write_bytes(content)
    model = openvino.Core().read_model(tmp_path / "embed-127.xml")
    assert list(model.input(0).shape) == [1, 127, 127, 3]
    write_graphs(tmp_path, graphs)
    manifest = tmp_path / MANIFEST
    manifest.write_text(manifest.read_text().replace("compare.onnx", "embed-127.xml"))
    with pytest.raises(EngineError, match=r"sha256|lists no compare\.onnx"):
        read_graphs(tmp_path)


@pytest.mark.parametrize("calibration", Calibration)
def test_eight_bits_are_near(graphs: Graphs, calibration: Calibration) -> None:
    pytest.importorskip("onnx")
    needed(ONNXRuntimeEngine)
    patches = [noise(287, seed)[0].numpy() for seed in range(3)]
    int8 = quantised(graphs, patches, calibration, layers=5)
    assert all(len(int8.embed[side_px]) < len(graphs.embed[side_px]) for side_px in graphs.embed)
    whole = ONNXRuntimeEngine(graphs, threads=1)
    engine = ONNXRuntimeEngine(int8, threads=1)
    assert engine.name == "onnxruntime-int8"
    for side_px in (127, 287):
        for found, wanted in zip(engine.embed(noise(side_px)), whole.embed(noise(side_px)), strict=True):
            error = (found - wanted).square().mean().sqrt()
            assert 0 < float(error) < 0.25 * float(wanted.std())


def test_openvino_runs_eight_bits_as_such(graphs: Graphs) -> None:
    """Its executed graph names the precision of each convolution: of five, the first two in 8 bits."""
    pytest.importorskip("onnx")
    needed(ONNXRuntimeEngine)
    openvino = needed(OpenVINOEngine).imported()
    int8 = quantised(graphs, [noise(287)[0].numpy()])
    core = openvino.Core()
    model = core.compile_model(core.read_model(int8.embed[287]), "CPU").get_runtime_model()
    facts = [op.get_rt_info() for op in model.get_ops()]
    # Fused as they are, their own names say which layer they are of.
    precisions = {
        str(f["originalLayersNames"].value).split("/")[2]: str(f["runtimePrecision"].value)
        for f in facts
        if f["layerType"].value == "Convolution"
    }
    if not set(precisions.values()) & {"u8", "i8"}:
        pytest.skip("this CPU has no 8-bit instructions that OpenVINO uses")
    assert {layer for layer, precision in precisions.items() if precision in ("u8", "i8")} == {"layer1", "layer2"}
    assert len(precisions) == 5


def test_calibration_patches_are_search_patches(tmp_path: Path) -> None:
    with pytest.raises(EngineError, match="int8: no patches"):
        quantised(Graphs(TINY, {}, b"", None), [])
    import cv2

    for i in range(4):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((90, 120, 3), 10 * i, np.uint8))
    boxes = np.array([[50, 40, 20, 20], [np.nan] * 4, [50, 40, 20, 20], [50, 40, 0, 20]])
    seen: list[None] = []
    found = search_patches([Sequence("s", tmp_path, boxes)], 4, TrackerConfig(), lambda: seen.append(None))
    assert [(p.shape, int(p[143, 143, 0])) for p in found] == [((287, 287, 3), 0), ((287, 287, 3), 20)]
    assert len(seen) == 4
    with pytest.raises(EngineError, match="hold no object"):
        search_patches([Sequence("s", tmp_path, np.full((4, 4), np.nan))], 4, TrackerConfig())


@each_engine
def test_nothing_is_sent(engine_type: type[ExportedEngine]) -> None:
    """No socket is used; OpenVINO would tell of its import from a thread, so its reporting must not even be there."""
    needed(engine_type)
    program = f"""
import os, sys
def refuse(event, args):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.sendto", "socket.sendmsg"):
        sys.stderr.write(f"{{event}} {{args}}")
        sys.stderr.flush()
        os._exit(3)
sys.addaudithook(refuse)
from {engine_type.__module__} import {engine_type.__name__} as E
from tests.tracker.conftest import random_network
from tests.tracker.test_engines_export import noise
E(random_network(), threads=1).embed(noise(127))
assert sys.modules.get("openvino_telemetry") is None
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr


@each_engine
def test_signals_are_heard_after_engines_have_come_and_gone(engine_type: type[ExportedEngine]) -> None:
    """Ctrl-C is how a flight is ended."""
    needed(engine_type)
    program = f"""
import faulthandler, gc, os, signal
faulthandler.enable()  # Python's handlers run on the thread's stack for signals, if it has one
from {engine_type.__module__} import {engine_type.__name__} as E
from tests.tracker.conftest import random_network
engines = [E(random_network(), threads=1, climnet=False) for _ in range(3)]
while engines:
    engines.pop(0)
    gc.collect()
heard = []
signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
os.kill(os.getpid(), signal.SIGTERM)
assert heard == [signal.SIGTERM]
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
