"""The network in ONNX Runtime: on a CPU nearly as fast as OpenVINO, on more kinds of them."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from tracker.engines.correlations import without_correlations
from tracker.engines.exported import Array, ExportedEngine, Run
from tracker.network.correlation import correlate


class ONNXRuntimeEngine(ExportedEngine):
    """See Engine."""

    runtime = "onnxruntime"
    packages = ("onnxruntime", "onnx")

    @classmethod
    def extra(cls) -> str:
        """See ExportedEngine."""
        return "onnx"

    def _compile(self, graph: bytes) -> Run:
        self._module.disable_telemetry_events()  # on Windows it has some
        options = self._module.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3  # errors
        # A thread that waits for the next frame shall leave its core to those that have work.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # PyTorch correlates six times as fast as this runtime, which lays out only kernels it knows beforehand.
        rest, correlations = without_correlations(graph)
        session = self._module.InferenceSession(rest, options, providers=["CPUExecutionProvider"])
        names = [each.name for each in session.get_inputs()]

        def run(inputs: Mapping[str, Array]) -> list[Array]:
            given = dict(inputs)
            for search, template, name in correlations:
                given[name] = correlate(torch.from_numpy(inputs[search]), torch.from_numpy(inputs[template])).numpy()
            results: list[Array] = session.run(None, {name: given[name] for name in names})
            return results

        return run
