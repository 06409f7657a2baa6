"""What tests track with does not depend on the machine: the reference engine on one thread, as if measured before."""

from __future__ import annotations

import os
import tempfile

from gcs.engine_choice.measure import Candidate, Measured
from gcs.engine_choice.memory import remember

_CACHE = tempfile.TemporaryDirectory(prefix="climrt-tests-")
os.environ["CLIMRT_CACHE"] = _CACHE.name  # processes that a test starts inherit it
remember(
    [
        Measured(Candidate("compact", engine, threads, None), *((12.0, 12.0) if engine == "torch" else (24.0, 24.0)))
        for engine in ("torch", "onnxruntime", "openvino")
        for threads in (1, 2, 4)
    ]
)
