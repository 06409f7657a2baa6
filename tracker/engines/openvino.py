"""The network in OpenVINO, on a CPU in float32 as the reference."""

from __future__ import annotations

import functools
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from tracker.engines.exported import Array, ExportedEngine, Run


class OpenVINOEngine(ExportedEngine):
    """See Engine."""

    runtime = "openvino"
    packages = ("openvino",)

    @classmethod
    def imported(cls) -> ModuleType:
        """See ExportedEngine."""
        # At its very import OpenVINO tells Google Analytics of it, unless the package that does so is not to be had.
        sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
        return super().imported()

    def _compile(self, graph: bytes) -> Run:
        core = _core()
        compiled = core.compile_model(core.read_model(graph), "CPU", _properties(self.threads))
        request = compiled.create_infer_request()
        ports = [port.get_names() for port in compiled.inputs]  # each its own and its optimised-away neighbours'

        def run(inputs: Mapping[str, Array]) -> list[Array]:
            wanted = [next(array for name, array in inputs.items() if name in names) for names in ports]
            results = request.infer(wanted, share_inputs=True, share_outputs=True)
            return [array.copy() for array in results.values()]  # the next run writes into these

        return run


@functools.cache
def _core() -> Any:
    """One for the process, which is never given up.

    Each takes the place of the thread's stack for signals and puts back, when it goes, what it had found: of two that
    go in another order than they came, that is memory given back already, and the next signal kills the process.
    """
    return OpenVINOEngine.imported().Core()


def _properties(threads: int) -> dict[str, object]:
    return {
        "INFERENCE_NUM_THREADS": threads,
        "NUM_STREAMS": 1,
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_PRECISION_HINT": "f32",  # some CPUs would take bfloat16
        "ENABLE_CPU_PINNING": False,  # decoding and the rest share these cores: the system knows which is free
    }


def as_ir(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Graphs NAME.onnx in OpenVINO's own form, each NAME.xml and NAME.bin, weights as they are. Raises EngineError."""
    openvino, core = OpenVINOEngine.imported(), _core()
    converted: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, graph in files.items():
            path = Path(folder) / Path(name).with_suffix(".xml")
            openvino.save_model(core.read_model(graph), path, compress_to_fp16=False)
            converted |= {part.name: part.read_bytes() for part in (path, path.with_suffix(".bin"))}
    return converted
