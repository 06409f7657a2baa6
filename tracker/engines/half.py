"""The network in the number formats of a GPU's matrix units, where that costs little accuracy."""

from __future__ import annotations

from enum import Enum
from typing import Any

import torch
from torch import Tensor, nn

from tracker.network.climrt import ClimRT
from tracker.network.inference import for_inference


class Precision(Enum):
    """What backbone and ClimNet compute in. The heads, 0.4 % of the work, always compute in FP32."""

    FP32 = "fp32"
    TF32 = "tf32"  # FP32 whose convolutions a GPU of NVIDIA rounds to 10 bits; FP32 on anything else
    BF16 = "bf16"  # 7 bits, the range of FP32
    FP16 = "fp16"  # 10 bits, up to 65504

    @property
    def dtype(self) -> torch.dtype:
        """Of the weights and what lies between the layers."""
        halves = {Precision.BF16: torch.bfloat16, Precision.FP16: torch.float16}
        return halves.get(self, torch.float32)


class Cast(nn.Module):
    """A module that takes tensors of any float type, computes in its own, and gives float32 or its own."""

    def __init__(self, module: nn.Module, dtype: torch.dtype, *, gives_float32: bool) -> None:
        super().__init__()
        self.module = module.to(dtype)
        self.dtype, self.gives_float32 = dtype, gives_float32

    def forward(self, x: Tensor) -> Any:
        """As the module's; x is cast before."""
        y = self.module(x.to(self.dtype))
        if not self.gives_float32:
            return y
        return y.float() if isinstance(y, Tensor) else tuple(each.float() for each in y)


@torch.no_grad()
def in_precision(network: ClimRT, precision: Precision) -> ClimRT:
    """A frozen copy as `for_inference` makes it, computing in this precision; its steps still take and give float32.

    Correlation and heads stay float32: sums of the correlation can pass what FP16 holds. So do ClimNet's first and
    last step, for grey levels: the means are taken off before, and put back after, what is rounded.
    """
    ready = for_inference(network)
    dtype = precision.dtype
    if dtype is torch.float32:
        return ready
    ready.set_submodule("backbone", Cast(ready.backbone, dtype, gives_float32=True))
    if ready.internet is not None:
        first, last = (ready.get_submodule(f"internet.{name}") for name in ("stem_space", "out"))
        ready.set_submodule("internet.out", nn.Identity())  # its weights are not to be rounded
        ready.internet.to(dtype)
        ready.set_submodule("internet.stem_space", Cast(first, dtype, gives_float32=False))
        ready.set_submodule("internet.out", Cast(last, torch.float32, gives_float32=True))
    return ready
