"""The engine for GPUs of NVIDIA: the frame goes up once, all else happens there, each step as one CUDA graph."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tracker.configs import LatentProvider, TrackerConfig
from tracker.crop import Colour, Image
from tracker.engines.device_crop import Plan, cut, plan_crop, used_window
from tracker.engines.engine import Patch
from tracker.engines.half import Precision, in_precision
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT, Features
from tracker.network.heads import Predictions

WARM_UPS = 3  # in which cuDNN tries its algorithms and PyTorch makes its workspaces
CHANNELS = (4, 2, 1)  # of Predictions

Tensors = tuple[Tensor, ...]


class CudaEngine:
    """See Engine. On any other device it does the same, without graphs."""

    def __init__(
        self, network: ClimRT, precision: Precision = Precision.FP16, device: torch.device | None = None
    ) -> None:
        """network: as trained; it is copied and made ready here. device: None, where its parameters are."""
        self.name = f"cuda-{precision.value}"
        self.has_climnet = network.internet is not None
        self._device = device or next(network.parameters()).device
        self._network = in_precision(network, precision).to(self._device)
        self._frame = FrameOnDevice(self._device)
        rounds = precision is not Precision.FP32
        if self._device.type == "cuda":
            torch.backends.cudnn.allow_tf32 = False  # for what the tracker does with it outside the graphs
        self._cut = Replayed(self._cut_out, self._device)
        self._embed = Replayed(self._embedded, self._device, rounds=rounds)
        self._imagine = Replayed(self._imagined, self._device, rounds=rounds)
        self._compare = Replayed(self._compared, self._device)

    def warm_up(self, config: TrackerConfig) -> None:
        """Record what a tracker so configured will ask for, which takes seconds, before a frame has to wait for it."""
        template, patch = (
            torch.zeros(1, side_px, side_px, 3, dtype=torch.uint8, device=self._device)
            for side_px in (config.exemplar_px, config.search_px)
        )
        features = self.embed(patch)
        latent5 = self.imagine(patch, patch) if config.latent is LatentProvider.CLIMNET else features[-1]
        self.compare(features, self.embed(template), latent5)

    @torch.inference_mode()
    def cut(self, frame_bgr: Image, cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour) -> Patch:
        """See Engine."""
        frame_wh_px = (frame_bgr.shape[1], frame_bgr.shape[0])
        plan = plan_crop(frame_wh_px, cx_px, cy_px, side_px, out_px, fill)
        frame = self._frame.with_window(frame_bgr, used_window(plan))
        (patch,) = self._cut(frame, uploaded(plan, self._device)[0])
        return patch

    @torch.inference_mode()
    def embed(self, patch: Patch) -> Features:
        """See Engine."""
        return self._embed(patch)

    @torch.inference_mode()
    def compare(self, search: Features, template: Features, latent5: Tensor) -> Predictions:
        """See Engine."""
        (maps,) = self._compare(*search, *template, latent5)
        return Predictions(*torch.split(maps, list(CHANNELS), 1))

    @torch.inference_mode()
    def imagine(self, earlier: Patch, current: Patch) -> Tensor:
        """See Engine."""
        (features5,) = self._imagine(earlier, current)
        return features5

    def _cut_out(self, *frame_and_plan: Tensor) -> Tensors:
        return (cut(*frame_and_plan),)

    def _embedded(self, *patch: Tensor) -> Tensors:
        return self._network.features(_as_input(*patch))

    def _imagined(self, *patches: Tensor) -> Tensors:
        assert self._network.internet is not None, "has_climnet says whether this may be asked"
        between = latent_patch(self._network.internet, *(_as_input(patch) for patch in patches))
        return (self._network.features(between)[-1],)

    def _compared(self, *features: Tensor) -> Tensors:
        """Search, template and latent features to all maps in one (1, 7, 11, 11): one copy, one transfer."""
        layers = len(features) // 2
        predictions = self._network.heads(features[:layers], features[layers:-1], features[-1])
        return (torch.cat(predictions, 1),)


class FrameOnDevice:
    """The frame that is being worked on: copied when it is another, or when it changed where it is asked for."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._frame: Image | None = None  # kept, so that no other can come to be at its place in memory
        self._copies: tuple[Tensor, Image | Plan] | None = None  # there, and what was sent
        self.uploads = 0

    def with_window(self, frame_bgr: Image, window: tuple[slice, slice]) -> Tensor:
        """The frame (H, W, 3) uint8 on the device, right at least in this window (rows, columns)."""
        if self._copies is None or frame_bgr is not self._frame or not _alike(frame_bgr, self._copies[1], window):
            self._copies, self._frame = uploaded(frame_bgr, self._device), frame_bgr
            self.uploads += 1
        return self._copies[0]


def _alike(frame_bgr: Image, sent: Image | Plan, window: tuple[slice, slice]) -> bool:
    """Whether it is the picture that was sent: video sources use their arrays again."""
    return frame_bgr.shape == sent.shape and np.array_equal(frame_bgr[window], sent[window])


def uploaded(array: Image | Plan, device: torch.device) -> tuple[Tensor, Image | Plan]:
    """The array on the device, soon, without waiting; and what was sent, which nobody else changes.

    It goes through pinned memory of PyTorch's own, which that uses again once the copy is through.
    """
    dtype = getattr(torch, array.dtype.name)
    pinned = torch.empty(array.shape, dtype=dtype, pin_memory=device.type == "cuda")
    sent = pinned.numpy()
    np.copyto(sent, array)
    return pinned.to(device, non_blocking=True), sent


def _as_input(patch: Patch) -> Tensor:
    """(1, S, S, 3) uint8 to (1, 3, S, S) float 0..255; stays channels-last in memory, as the network's."""
    return patch.permute(0, 3, 1, 2).float()


@dataclass(frozen=True, slots=True)
class _Recording:
    graph: torch.cuda.CUDAGraph
    inputs: Tensors
    outputs: Tensors


class Replayed:
    """A function of tensors that on a GPU is recorded once for all inputs of the same shapes, then replayed.

    The function may not wait for the GPU, nor do anything but with its inputs and with what never changes.
    """

    def __init__(self, function: Callable[..., Tensors], device: torch.device, *, rounds: bool = False) -> None:
        """rounds: whether float32 convolutions may run in TF32."""
        self._function, self._device, self._rounds = function, device, rounds
        self._recordings: dict[tuple[object, ...], _Recording] = {}

    def __call__(self, *inputs: Tensor) -> Tensors:
        """What the function returns; the caller's own."""
        if self._device.type != "cuda":
            return self._function(*inputs)
        key = tuple((tensor.shape, tensor.stride()) for tensor in inputs)
        recording = self._recordings.get(key)
        if recording is None:
            recording = self._recordings[key] = self._record(inputs)
        for kept, given in zip(recording.inputs, inputs, strict=True):
            kept.copy_(given, non_blocking=True)
        recording.graph.replay()
        return tuple(output.clone() for output in recording.outputs)

    def _record(self, inputs: Tensors) -> _Recording:
        kept = tuple(tensor.clone() for tensor in inputs)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.device(self._device), self._convolutions():
            aside: torch.cuda.Stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):
                for _ in range(WARM_UPS):
                    self._function(*kept)
            torch.cuda.current_stream().wait_stream(aside)
            # Other threads of the program may use the GPU meanwhile.
            with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                outputs = self._function(*kept)
        return _Recording(graph, kept, outputs)

    def _convolutions(self) -> contextlib.AbstractContextManager[None]:
        """How cuDNN is to choose its algorithms; a recording keeps the choice."""
        return torch.backends.cudnn.flags(enabled=True, benchmark=True, allow_tf32=self._rounds)
