"""The processes that train together: one with plain PyTorch, or several through Lightning Fabric.

Started by torchrun (`torchrun --nproc-per-node N ...`, on one machine or several) or by --devices N. Each process
draws its own samples; gradients are averaged over all of them. The first one alone writes files and speaks.
"""

from __future__ import annotations

import logging
import os
import warnings
from typing import Any, TypeVar

import torch
from torch import nn

from tracker.train.config import Precision, TrainConfigError

T = TypeVar("T")


class Team:
    """One process's view of all that train together. rank 0 leads; size 1 needs no other library."""

    def __init__(self, device: torch.device, fabric: Any = None) -> None:
        self.fabric = fabric
        self.device = device
        self.rank: int = fabric.global_rank if fabric else 0
        self.size: int = fabric.world_size if fabric else 1

    @property
    def leads(self) -> bool:
        """Whether this process writes files and speaks."""
        return self.rank == 0

    def prepare(self, network: nn.Module) -> nn.Module:
        """Batch normalisation over all processes where PyTorch can (GPUs only)."""
        if self.size > 1 and self.device.type == "cuda":
            return nn.SyncBatchNorm.convert_sync_batchnorm(network)
        return network

    def wrap(self, module: nn.Module) -> nn.Module:
        """The module whose forward pass ties the gradients of all processes together."""
        return self.fabric.setup_module(module) if self.fabric else module

    def backward(self, loss: torch.Tensor) -> None:
        """Gradients, averaged over the processes."""
        if self.fabric:
            self.fabric.backward(loss)
        else:
            loss.backward()

    def agree(self, now_s: float, stop: bool) -> tuple[float, bool]:
        """The leader's time, and whether anybody wants to stop: every process then decides alike."""
        if self.size == 1:
            return now_s, stop
        mine = torch.tensor([now_s if self.leads else -1.0, float(stop)], dtype=torch.float64, device=self.device)
        now, stopping = self.fabric.all_reduce(mine, reduce_op="max").tolist()
        return now, stopping > 0

    def share(self, value: T) -> T:
        """The leader's value, for all."""
        return self.fabric.broadcast(value) if self.size > 1 else value

    def disband(self) -> None:
        """Closes the connections, once all are through: left to the interpreter's end, their threads may abort it."""
        if self.size > 1:
            self.fabric.barrier()
            torch.distributed.destroy_process_group()


def assemble(devices: int = 1, device: str = "auto") -> Team:
    """This process's place among those that train together, which are started where need be.

    devices: processes on this machine, one device each; torchrun's number where it started us. device: auto, cpu
    or cuda. Raises TrainConfigError where several are asked for and lightning_fabric is not installed.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise TrainConfigError("device = cuda: this PyTorch finds no GPU")
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    world, nodes = int(os.environ.get("WORLD_SIZE", "1")), 1
    if world > 1:
        devices = int(os.environ.get("LOCAL_WORLD_SIZE", world))
        nodes = world // devices
    if devices * nodes == 1:
        return Team(torch.device(device))
    try:
        from lightning_fabric import Fabric
    except ImportError:
        raise TrainConfigError("several processes need Lightning Fabric: pip install 'climrt-gcs[train]'") from None
    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message="Grad strides do not match bucket view strides")  # of ClimNet's 1x1x1
    fabric = Fabric(accelerator=device, devices=devices, num_nodes=nodes, strategy="ddp")
    fabric.launch()
    return Team(fabric.device, fabric)


def in_bf16(precision: Precision, device: torch.device) -> bool:
    """Whether the forward pass runs in bf16: on GPUs, and on CPUs that compute in it (elsewhere it is slower)."""
    if precision is not Precision.AUTO:
        return precision is Precision.BF16
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    able = torch.cpu.get_capabilities() if device.type == "cpu" else {}
    return bool(able.get("avx512_bf16") or able.get("amx_bf16") or able.get("amx_tile"))
