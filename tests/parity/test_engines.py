"""The engines that run exported graphs against the reference engine and against the authors' code."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from sitl_mocks import sequences
from tests.parity.conftest import Golden, patch
from tracker.box import Box
from tracker.engines.eager import EagerEngine
from tracker.engines.engine import Engine, Patch
from tracker.engines.export import Graphs, export
from tracker.engines.exported import ExportedEngine
from tracker.engines.onnxruntime import ONNXRuntimeEngine
from tracker.engines.openvino import OpenVINOEngine
from tracker.eval.sequences import Sequence, read_boxes
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.inference import for_inference
from tracker.online import ClimRTTracker
from tracker.weights import find_weights, load_network, read_manifest

Make = Callable[[ClimRT | Graphs], ExportedEngine]
FEATURES_ATOL = 1e-3  # of their standard deviation
MAPS_ATOL = 1e-4
TRACK_ATOL_PX = 0.05
TRACK_FRAMES = 40


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Threads of small steps wait for each other where other tests want the cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module", params=[OpenVINOEngine, ONNXRuntimeEngine], ids=lambda engine: engine.runtime)
def make(request: pytest.FixtureRequest) -> Make:
    if importlib.util.find_spec(request.param.runtime) is None:
        pytest.skip(f"{request.param.runtime} is not installed")
    return lambda network: request.param(network, threads=1)


@cache
def compact() -> tuple[ClimRT, Graphs]:
    network = load_network(find_weights("compact"))
    return network, export(network)


@pytest.fixture(scope="module")
def full_graphs(full: ClimRT) -> Graphs:
    return export(full)


def pixels(seed: int, side_px: int) -> Patch:
    """The reference data's patch as an engine takes it: (1, S, S, 3) uint8."""
    return patch(seed, side_px).permute(0, 2, 3, 1).to(torch.uint8).contiguous()


def video_patches(count: int = 3) -> list[Patch]:
    """Search patches of a shipped sequence, some frames apart."""
    frames = [image for i, image in enumerate(car().images()) if i % 10 == 0]
    boxes = [Box.from_xywh(*xywh) for xywh in car().truth_xywh[::10]]
    cut = EagerEngine(compact()[0]).cut
    return [cut(f, b.cx_px, b.cy_px, 200, 287, (0, 0, 0)) for f, b in list(zip(frames, boxes, strict=True))[:count]]


@cache
def car() -> Sequence:
    return Sequence("car", sequences.path("car"), read_boxes(sequences.path("car", ".txt")))


def assert_like(found: Tensor, wanted: Tensor, atol: float) -> None:
    assert found.dtype == torch.float32
    assert found.shape == wanted.shape
    assert float((found - wanted).abs().max()) <= atol


def assert_same_answers(engine: Engine, reference: Engine, template: Patch, search: Patch) -> None:
    features = [reference.embed(p) for p in (template, search)]
    for patch_, wanted in zip((template, search), features, strict=True):
        for layer, wanted_layer in zip(engine.embed(patch_), wanted, strict=True):
            assert_like(layer, wanted_layer, FEATURES_ATOL * float(wanted_layer.std()))
    wanted_maps = reference.compare(features[1], features[0], features[1][-1])
    for found, wanted_map in zip(engine.compare(features[1], features[0], features[1][-1]), wanted_maps, strict=True):
        assert_like(found, wanted_map, MAPS_ATOL)


def assert_levels(found: Patch, wanted: Tensor) -> None:
    """Grey levels of a latent frame: here and there one more or less, where rounding tips it."""
    assert found.dtype == torch.uint8
    assert found.shape == wanted.shape
    difference = (found.int() - wanted.int()).abs()
    assert int(difference.max()) <= 1
    assert float((difference != 0).float().mean()) < 0.005


def test_compact_equals_the_reference_engine(make: Make) -> None:
    network, graphs = compact()
    engine, reference = make(graphs), EagerEngine(network)
    earlier, current = video_patches(2)
    template = reference.cut(next(car().images()), 240, 140, 90, 127, (1, 2, 3))
    assert_same_answers(engine, reference, template, current)

    planes = [p.permute(0, 3, 1, 2).float() for p in (earlier, current)]
    ready = for_inference(network)
    wanted = latent_patch(ready.internet, *planes)
    assert_levels(engine.between(earlier, current), wanted.permute(0, 2, 3, 1))
    # A level in one place moves a feature more than any rounding: on the whole they must agree.
    found, wanted5 = engine.imagine(earlier, current), reference.imagine(earlier, current)
    assert float((found - wanted5).square().mean().sqrt()) <= FEATURES_ATOL * float(wanted5.std())


def test_results_belong_to_the_caller(make: Make) -> None:
    engine = make(compact()[1])
    first, second = video_patches(2)
    features = engine.embed(first)
    kept = [layer.clone() for layer in features]
    maps = engine.compare(features, engine.embed(pixels(100, 127)), features[-1])
    kept_maps = [m.clone() for m in maps]
    other = engine.embed(second)
    engine.compare(other, engine.embed(pixels(101, 127)), other[-1])
    engine.imagine(first, second)
    for now, before in zip((*features, *maps), (*kept, *kept_maps), strict=True):
        torch.testing.assert_close(now, before, rtol=0, atol=0)


def test_whole_track_of_a_shipped_sequence(make: Make) -> None:
    manifest = read_manifest(find_weights("compact"))
    network, graphs = compact()
    trackers = [
        ClimRTTracker(engine, manifest.tracker, confidence=manifest.confidence)
        for engine in (EagerEngine(network), make(graphs))
    ]
    first = Box.from_xywh(*(float(v) for v in car().truth_xywh[0]))
    for i, image in zip(range(TRACK_FRAMES), car().images(), strict=False):
        if i == 0:
            for tracker in trackers:
                tracker.init(image, first)
            continue
        wanted, found = (tracker.update(image) for tracker in trackers)
        np.testing.assert_allclose(found.box.xywh, wanted.box.xywh, rtol=0, atol=TRACK_ATOL_PX, err_msg=f"frame {i}")
        assert found.visible == wanted.visible


@pytest.mark.slow
def test_full_network_equals_the_authors(make: Make, full: ClimRT, full_graphs: Graphs, golden: Golden) -> None:
    engine = make(full_graphs)
    backbone, heads = golden("a_backbone"), golden("c_lct_heads")
    template, search = engine.embed(pixels(100, 127)), engine.embed(pixels(200, 287))
    latent5 = engine.embed(pixels(300, 287))[-1]
    np.testing.assert_allclose(template[0], backbone["z4"], rtol=0, atol=1e-3)
    np.testing.assert_allclose(template[1], backbone["z5"], rtol=0, atol=1e-3)
    np.testing.assert_allclose(search[0][:, ::24], backbone["x4_ch0_24"], rtol=0, atol=1e-3)
    np.testing.assert_allclose(search[1][:, ::16], backbone["x5_ch0_16"], rtol=0, atol=1e-3)
    for name, found in engine.compare(search, template, latent5)._asdict().items():
        np.testing.assert_allclose(found, heads[name], rtol=0, atol=MAPS_ATOL, err_msg=name)

    latent = engine.between(pixels(410, 287), pixels(510, 287))
    wanted = golden("b_climnet")["latent287_u8_sub3"].astype(int)
    assert_levels(latent[:, ::3, ::3].permute(0, 3, 1, 2), torch.from_numpy(wanted).reshape(1, 3, 96, 96))
