"""Which engines there are, which of them can run here, and how one is made."""

from __future__ import annotations

import importlib.util
from typing import Final

import torch

from tracker.engines.cuda import CudaEngine
from tracker.engines.eager import EagerEngine
from tracker.engines.engine import Engine, EngineError
from tracker.engines.export import Graphs
from tracker.engines.half import Precision
from tracker.engines.onnxruntime import ONNXRuntimeEngine
from tracker.engines.openvino import OpenVINOEngine
from tracker.network.climrt import ClimRT

TORCH: Final = "torch"
# ONNX Runtime before OpenVINO, where both cost about the same: it takes less memory and starts sooner.
EXPORTED: Final = {engine.runtime: engine for engine in (ONNXRuntimeEngine, OpenVINOEngine)}
ON_DEVICE: Final = {f"cuda-{precision.value}": precision for precision in Precision}
ENGINES: Final = (TORCH, *EXPORTED, *ON_DEVICE)


def available_engines() -> list[str]:
    """Those whose package, or device, is there, the one to prefer among equals first.

    On a GPU in half precision, the nearest to the reference.
    """
    found = [name for name, engine in EXPORTED.items() if all(map(importlib.util.find_spec, engine.packages))]
    return [*found, TORCH, *([f"cuda-{Precision.FP16.value}"] if torch.cuda.is_available() else [])]


def make_engine(name: str, network: ClimRT | Graphs, threads: int | None = None, *, climnet: bool = True) -> Engine:
    """By its name, for a network on the CPU, or for graphs that were exported from one.

    threads: of an engine that brings its own, None: one. climnet=False: it will not be asked to imagine. Raises
    EngineError, one line.
    """
    if name in EXPORTED:
        return EXPORTED[name](network, threads=threads or 1, climnet=climnet)
    if not isinstance(network, ClimRT):
        raise EngineError(f"engine {name}: runs no exported graphs; {' and '.join(EXPORTED)} do")
    if name == TORCH:
        return EagerEngine(network)
    if name in ON_DEVICE:
        if not torch.cuda.is_available():
            raise EngineError(f"engine {name}: PyTorch finds no GPU here")
        return CudaEngine(network, ON_DEVICE[name], torch.device("cuda"))
    raise EngineError(f"engine {name}: none of {', '.join(ENGINES)}")
