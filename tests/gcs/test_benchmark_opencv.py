"""OpenCV's network trackers in the benchmark, with networks of their form (and nothing learned) written here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.benchmark import trackers
from gcs.benchmark.films import sample

onnx = pytest.importorskip("onnx", reason="needs the extra onnx")


def conv(name: str, image: str, out: str, shape: tuple[int, int, int, int], stride: int) -> tuple[object, object]:
    """A convolution's node and its weights, drawn by lot."""
    weights = np.random.default_rng(1).normal(0, 0.01, shape).astype(np.float32)
    node = onnx.helper.make_node("Conv", [image, name], [out], strides=[stride, stride])
    return node, onnx.numpy_helper.from_array(weights, name)


def written(path: Path, nodes: list, weights: list, inputs: dict, outputs: dict) -> Path:
    def values(shapes: dict) -> list:
        return [onnx.helper.make_tensor_value_info(name, 1, shape) for name, shape in shapes.items()]

    graph = onnx.helper.make_graph(nodes, "net", values(inputs), values(outputs), weights)
    opset = [onnx.helper.make_opsetid("", 13)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=8), path)
    return path


def nano_networks(folder: Path) -> tuple[Path, Path]:
    """127 px of template and 255 px of search, features of stride 16; scores and sides on 16x16 cells."""
    features, kernel = conv("w", "input", "output", (8, 3, 15, 15), 16)
    side = ["n", 3, "h", "w"]
    backbone = written(folder / "backbone.onnx", [features], [kernel], {"input": side}, {"output": ["n", 8, "p", "q"]})
    scores, score_weights = conv("s", "seen", "output1", (2, 8, 1, 1), 1)
    sides, side_weights = conv("b", "seen", "output2", (4, 8, 1, 1), 1)
    nodes = [
        onnx.helper.make_node("GlobalAveragePool", ["input1"], ["wanted"]),
        onnx.helper.make_node("Mul", ["input2", "wanted"], ["seen"]),
        scores,
        sides,
    ]
    inputs = {"input1": [1, 8, 8, 8], "input2": [1, 8, 16, 16]}
    outputs = {"output1": [1, 2, 16, 16], "output2": [1, 4, 16, 16]}
    return backbone, written(folder / "head.onnx", nodes, [score_weights, side_weights], inputs, outputs)


def vit_network(folder: Path) -> Path:
    """128 px of template, 256 px of search; score, size and offset on 16x16 cells, each between 0 and 1."""
    nodes: list = [
        onnx.helper.make_node("GlobalAveragePool", ["template"], ["wanted"]),
        onnx.helper.make_node("Mul", ["search", "wanted"], ["seen"]),
    ]
    weights = []
    for index, channels in ((1, 1), (2, 2), (3, 2)):
        node, kernel = conv(f"w{index}", "seen", f"raw{index}", (channels, 3, 16, 16), 16)
        nodes += [node, onnx.helper.make_node("Sigmoid", [f"raw{index}"], [f"output{index}"])]
        weights.append(kernel)
    inputs = {"template": [1, 3, 128, 128], "search": [1, 3, 256, 256]}
    outputs = {"output1": [1, 1, 16, 16], "output2": [1, 2, 16, 16], "output3": [1, 2, 16, 16]}
    return written(folder / "vit.onnx", nodes, weights, inputs, outputs)


def test_networks_that_are_given_are_measured(tmp_path: Path) -> None:
    notes: list[str] = []
    cases = list(trackers.of_opencv(sample(6), 1, nano_networks(tmp_path), vit_network(tmp_path), notes.append))
    assert [case.name for case in cases] == ["OpenCV MIL", "OpenCV Nano", "OpenCV Vit"]
    assert notes == []
    for case in cases[1:]:
        turn = case.turn()
        assert len(turn) > 3
        assert all(each.wall_ms > 0 and each.cpu_ms > 0 for each in turn)
