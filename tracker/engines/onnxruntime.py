"""The network in ONNX Runtime: on a CPU nearly as fast as OpenVINO, on more kinds of them."""

from __future__ import annotations

from collections.abc import Mapping

from tracker.engines.exported import Array, ExportedEngine, Run


class ONNXRuntimeEngine(ExportedEngine):
    """See Engine."""

    runtime = "onnxruntime"

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
        session = self._module.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        names = [each.name for each in session.get_inputs()]

        def run(inputs: Mapping[str, Array]) -> list[Array]:
            results: list[Array] = session.run(None, {name: inputs[name] for name in names})
            return results

        return run
