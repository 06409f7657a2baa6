"""A network as ONNX graphs of fixed shapes, which other runtimes run: embed, compare and, with ClimNet, between."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from tracker.configs import NetworkConfig, TrackerConfig
from tracker.network.backbone import Backbone, Features
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.heads import Grader
from tracker.network.inference import for_inference

OPSET = 18
SIDES_PX = (TrackerConfig().exemplar_px, TrackerConfig().search_px)  # of the patches: template, search
SEARCH_PX = SIDES_PX[1]
FLOAT32 = "f32"
INT8 = "int8"


@dataclass(frozen=True, slots=True)
class Graphs:
    """One network as serialised ONNX models; batch 1 and all sizes fixed.

    embed: by side S of the patch: patch (1, S, S, 3) uint8 BGR to its features, layer 5 last.
    compare: compare_inputs to loc, cls1, cls2; without those that the variant does not use.
    between: two search patches (1, S, S, 3) uint8 to the one that ClimNet draws between them, cut to grey levels
    as the authors', uint8 of the same shape; None without ClimNet. Its features are embed's business.
    precision: f32, or int8 where embed is quantised.
    """

    network: NetworkConfig
    embed: Mapping[int, bytes] = field(repr=False)
    compare: bytes = field(repr=False)
    between: bytes | None = field(repr=False)
    precision: str = FLOAT32

    def files(self) -> dict[str, bytes]:
        """Each graph under the name of its file."""
        named = {f"embed-{side_px}.onnx": graph for side_px, graph in self.embed.items()}
        named["compare.onnx"] = self.compare
        return named if self.between is None else named | {"between.onnx": self.between}

    def with_int8(self, embed: Mapping[int, bytes]) -> Graphs:
        """The same with these quantised graphs in embed's place."""
        return replace(self, embed=embed, precision=INT8)


class _Embed(nn.Module):
    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.backbone = backbone

    def forward(self, patch: Tensor) -> tuple[Tensor, ...]:
        """(1, S, S, 3) uint8 to the features of the last layers."""
        features: Features = self.backbone(_planes(patch))
        return features


class _Compare(nn.Module):
    def __init__(self, grader: Grader) -> None:
        super().__init__()
        self.grader = grader

    def forward(self, *features: Tensor) -> tuple[Tensor, ...]:
        """Search, template (each as many layers) and latent5, to loc, cls1, cls2."""
        layers = len(features) // 2
        return tuple(self.grader(features[:layers], features[layers : 2 * layers], features[-1]))


class _Between(nn.Module):
    def __init__(self, climnet: nn.Module) -> None:
        super().__init__()
        self.climnet = climnet

    def forward(self, earlier: Tensor, current: Tensor) -> Tensor:
        """Two patches (1, S, S, 3) uint8 to the one between them, the same."""
        between = latent_patch(self.climnet, _planes(earlier), _planes(current))  # (1, 3, S, S)
        return between.permute(0, 2, 3, 1).to(torch.uint8)


def _activate_first(backbone: Backbone) -> None:
    # Without a change in any number: convolution and activation become one step, and an 8-bit one has no sign to keep.
    for layer in (backbone.layer1, backbone.layer2):
        pool, activation = layer[2], layer[3]
        layer[1], layer[2], layer[3] = activation, pool, nn.Identity()


def _planes(patch: Tensor) -> Tensor:
    return patch.permute(0, 3, 1, 2).float()  # (1, 3, S, S)


def layer_names(count: int) -> tuple[str, ...]:
    """Names of the last layers of the backbone."""
    return ("layer3", "layer4", "layer5")[-count:]


def compare_inputs(search: Features, template: Features, latent5: Tensor) -> dict[str, Tensor]:
    """What compare is given, under the names of its graph's inputs."""
    layers = layer_names(len(search))
    return {
        **{f"search_{layer}": tensor for layer, tensor in zip(layers, search, strict=True)},
        **{f"template_{layer}": tensor for layer, tensor in zip(layers, template, strict=True)},
        "latent_layer5": latent5,
    }


def export(network: ClimRT, *, climnet: bool = True) -> Graphs:
    """The graphs of a network as trained. climnet=False leaves ClimNet out, where no latent frame will be drawn."""
    ready = for_inference(network).cpu()
    _activate_first(ready.backbone)
    layers = layer_names(3 if ready.backbone.gives_layer3 else 2)
    with _tracing():
        embed, features = {}, {}
        for side_px in SIDES_PX:
            patch = torch.zeros(1, side_px, side_px, 3, dtype=torch.uint8)
            embed[side_px] = _traced(_Embed(ready.backbone), (patch,), ("patch",), layers)
            features[side_px] = ready.backbone(_planes(patch))
        search, template = features[SEARCH_PX], features[SIDES_PX[0]]
        inputs = compare_inputs(search, template, search[-1].clone())  # tensors of their own, whatever their values
        compare = _traced(_Compare(ready.grader), (*inputs.values(),), (*inputs,), ("loc", "cls1", "cls2"))
        between = None
        if climnet and ready.internet is not None:
            between = _traced(_Between(ready.internet), (patch, patch.clone()), ("earlier", "current"), ("between",))
    return Graphs(network.config, embed, compare, between)


@contextmanager
def _tracing() -> Iterator[None]:
    """Attention in its written-out form, no gradients, and none of the exporter's remarks on its own future.

    On one thread: it folds thousands of small tensors, over which several threads wait for each other (5 s for 0.5).
    """
    was_fast, threads = torch.backends.mha.get_fastpath_enabled(), torch.get_num_threads()
    torch.backends.mha.set_fastpath_enabled(False)
    torch.set_num_threads(1)
    try:
        with torch.no_grad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        torch.set_num_threads(threads)
        torch.backends.mha.set_fastpath_enabled(was_fast)


def _traced(module: nn.Module, args: tuple[Tensor, ...], inputs: Sequence[str], outputs: Sequence[str]) -> bytes:
    file = io.BytesIO()
    torch.onnx.export(
        module.eval(),
        args,
        file,  # type: ignore[arg-type]  # this exporter takes it
        dynamo=False,
        opset_version=OPSET,
        input_names=[*inputs],
        output_names=[*outputs],
    )
    return file.getvalue()
