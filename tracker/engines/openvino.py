"""The network in OpenVINO: on a CPU the fastest there is, in float32 as the reference."""

from __future__ import annotations

from collections.abc import Sequence

from tracker.engines.exported import Array, ExportedEngine, Run


class OpenVINOEngine(ExportedEngine):
    """See Engine."""

    runtime = "openvino"

    def _compile(self, graph: bytes) -> Run:
        # Core reads models itself; openvino.convert_model, which would, is also what reports usage to its makers.
        core = self._module.Core()
        request = core.compile_model(core.read_model(graph), "CPU", _properties(self.threads)).create_infer_request()

        def run(inputs: Sequence[Array]) -> list[Array]:
            results = request.infer(inputs, share_inputs=True, share_outputs=True)
            return [array.copy() for array in results.values()]  # the next run writes into these

        return run


def _properties(threads: int) -> dict[str, object]:
    return {
        "INFERENCE_NUM_THREADS": threads,
        "NUM_STREAMS": 1,
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_PRECISION_HINT": "f32",  # some CPUs would take bfloat16
        "ENABLE_CPU_PINNING": False,  # decoding and the rest share these cores: the system knows which is free
    }
