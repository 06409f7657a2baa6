"""What tests track with does not depend on the machine: the reference engine on one thread, as if measured before."""

from __future__ import annotations

import os
import tempfile

# Processes that a test starts inherit it.
os.environ["CLIMRT_CACHE"] = tempfile.mkdtemp(prefix="climrt-tests-")

from gcs.engine_choice.measure import Candidate, Measured
from gcs.engine_choice.memory import remember

remember([Measured(Candidate("compact", "torch", 1, None), 12.0, 12.0)])
