"""What is compared: the same network run in different ways."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import torch

from tracker.engines.cuda import CudaEngine
from tracker.engines.eager import EagerEngine
from tracker.engines.engine import Engine
from tracker.engines.half import Precision
from tracker.network.climrt import ClimRT


@dataclass(frozen=True, slots=True)
class Variant:
    """One way to run a network. make: an engine from the network, on the device."""

    name: str
    precision: Precision
    make: Callable[[ClimRT, torch.device], Engine]

    def convolutions(self) -> contextlib.AbstractContextManager[None]:
        """How cuDNN rounds and chooses meanwhile."""
        rounds = self.precision is not Precision.FP32
        return torch.backends.cudnn.flags(enabled=True, benchmark=True, allow_tf32=rounds)


class CompiledEngine(CudaEngine):
    """Embed, imagine and compare by torch.compile in place of recorded graphs."""

    def __init__(self, network: ClimRT, precision: Precision, device: torch.device, mode: str) -> None:
        super().__init__(network, precision, device)
        self._embed = _compiled(self._embedded, mode)
        self._imagine = _compiled(self._imagined, mode)
        self._compare = _compiled(self._compared, mode)


def _compiled(function: Callable, mode: str) -> Callable:
    runs = torch.compile(function, mode=mode, dynamic=False)

    def cloned(*inputs: torch.Tensor) -> tuple[torch.Tensor, ...]:
        torch.compiler.cudagraph_mark_step_begin()
        return tuple(output.clone() for output in runs(*inputs))  # its own graphs use their outputs again

    return cloned


def _eager(network: ClimRT, device: torch.device) -> Engine:
    return EagerEngine(network.to(device))


def _graphs(precision: Precision) -> Variant:
    return Variant(f"graphs {precision.value}", precision, lambda network, to: CudaEngine(network, precision, to))


def _compile(mode: str) -> Variant:
    precision = Precision.FP16
    return Variant(f"compile {mode}", precision, lambda network, to: CompiledEngine(network, precision, to, mode))


VARIANTS = (
    Variant("eager fp32", Precision.FP32, _eager),
    Variant("eager tf32", Precision.TF32, _eager),
    *(_graphs(precision) for precision in Precision),
)
# Compiling may take minutes, or hang: each in a process of its own, as far as time allows.
COMPILED = (_compile("max-autotune-no-cudagraphs"), _compile("reduce-overhead"))
# A CPU knows no TF32, and computes FP16 a hundred times slower than FP32.
ON_CPU = ("eager fp32", "graphs fp32", "graphs bf16")
