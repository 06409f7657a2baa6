"""What the engines that run exported graphs share: a compiled graph each for embed, compare and between."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tracker.crop import Colour, Image, crop
from tracker.engines.engine import EngineError, Patch
from tracker.engines.export import FLOAT32, Graphs, compare_inputs, export
from tracker.engines.export_files import read_graphs
from tracker.network.climrt import ClimRT, Features
from tracker.network.heads import Predictions

Array: TypeAlias = NDArray[Any]
# Inputs by name, of which the graph may know only some, to outputs in its order that are the caller's.
Run = Callable[[Mapping[str, Array]], list[Array]]


class ExportedEngine:
    """See Engine. On the CPU, with exactly the threads it is given, whatever PyTorch and OpenCV have."""

    runtime: ClassVar[str]  # the engine's name, and of its package, and of the extra that brings it
    packages: ClassVar[tuple[str, ...]]  # that it needs, the runtime's first

    def __init__(self, network: ClimRT | Graphs, *, threads: int, climnet: bool = True) -> None:
        """network: as trained, exported here in memory; or graphs. climnet=False: none will be asked to imagine.

        Raises EngineError where the runtime's package is missing or refuses a graph.
        """
        if threads < 1:
            raise EngineError(f"engine {self.runtime}: threads {threads}: must be 1 or more")
        self._module = self.imported()
        self.threads = threads
        graphs = export(network, climnet=climnet) if isinstance(network, ClimRT) else network
        self.name = self.runtime if graphs.precision == FLOAT32 else f"{self.runtime}-{graphs.precision}"
        self._embed = {side_px: self._compiled(f"embed-{side_px}", graph) for side_px, graph in graphs.embed.items()}
        self._compare = self._compiled("compare", graphs.compare)
        self.has_climnet = climnet and graphs.between is not None
        self._between = self._compiled("between", graphs.between) if climnet and graphs.between is not None else None

    @classmethod
    def from_files(cls, folder: str | Path, *, threads: int, climnet: bool = True) -> Self:
        """From what `export_files.write_graphs` wrote. Raises EngineError."""
        return cls(read_graphs(folder), threads=threads, climnet=climnet)

    @classmethod
    def imported(cls) -> ModuleType:
        """The runtime's package, which all others are there with. Raises EngineError."""
        for name in reversed(cls.packages):
            try:
                module = importlib.import_module(name)
            except ModuleNotFoundError as error:
                raise EngineError(missing(f"engine {cls.runtime}", error.name or name, cls.extra())) from error
            except Exception as error:  # whatever a broken installation raises
                raise EngineError(
                    f"engine {cls.runtime}: the package {name} cannot be used: {_reason(error)}"
                ) from error
        return module

    @classmethod
    def extra(cls) -> str:
        """Of this package, the one that installs the runtime."""
        return cls.runtime

    def _compiled(self, name: str, graph: bytes) -> Run:
        try:
            return self._compile(graph)
        except Exception as error:  # each runtime has errors of its own
            raise EngineError(f"engine {self.runtime}: cannot run the graph {name}: {_reason(error)}") from error

    def _compile(self, graph: bytes) -> Run:
        raise NotImplementedError

    def cut(self, frame_bgr: Image, cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour) -> Patch:
        """See Engine."""
        return torch.from_numpy(crop(frame_bgr, cx_px, cy_px, side_px, out_px, fill))[None]

    def embed(self, patch: Patch) -> Features:
        """See Engine. Raises EngineError for a patch of a size that was not exported."""
        run = self._embed.get(patch.shape[1])
        if run is None:
            sizes = " and ".join(map(str, self._embed))
            raise EngineError(f"engine {self.name}: a patch of {patch.shape[1]} px: its graphs are for {sizes} px")
        return _tensors(run(_arrays({"patch": patch})))

    def compare(self, search: Features, template: Features, latent5: Tensor) -> Predictions:
        """See Engine."""
        return Predictions(*_tensors(self._compare(_arrays(compare_inputs(search, template, latent5)))))

    def imagine(self, earlier: Patch, current: Patch) -> Tensor:
        """See Engine."""
        return self.embed(self.between(earlier, current))[-1]

    def between(self, earlier: Patch, current: Patch) -> Patch:
        """The latent frame itself: what ClimNet draws between two search patches."""
        assert self._between is not None, "has_climnet says whether this may be asked"
        return _tensors(self._between(_arrays({"earlier": earlier, "current": current})))[0]


def _reason(error: Exception) -> str:
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[-1].strip()


def missing(what: str, package: str, extra: str) -> str:
    """One line for a package that is not there."""
    return f"{what}: the package {package} is not installed: pip install 'climrt-gcs[{extra}]'"


def _arrays(tensors: Mapping[str, Tensor]) -> dict[str, Array]:
    # Another engine's features may lie channels-last in memory; these runtimes take what they are declared to get.
    return {name: np.ascontiguousarray(tensor.numpy()) for name, tensor in tensors.items()}


def _tensors(arrays: Sequence[Array]) -> tuple[Tensor, ...]:
    return tuple(torch.from_numpy(array) for array in arrays)
