"""The ground control station: joins video, tracker, control and vehicle."""

import os
import platform

# Each kind of processor has its own order of adding up a matrix product, and so its own last bits. This one exists on
# all of x86-64: a flight flown again elsewhere decides the same, bit for bit. The matrices here are too small to be
# slower for it. NumPy reads it when it is first imported.
if platform.machine().lower() in ("x86_64", "amd64"):
    os.environ["OPENBLAS_CORETYPE"] = "Nehalem"

# Threads of PyTorch that spin while they wait for each other take the cores from decoding and control: on a busy
# machine two of them were ten times slower than one. Read when PyTorch is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
