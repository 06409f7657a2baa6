"""A trained network made ready for flight: the same outputs (to 1e-4), fewer operations."""

from __future__ import annotations

import copy

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from tracker.network.backbone import Backbone
from tracker.network.climrt import ClimRT
from tracker.network.folded import FoldedClimNet


@torch.no_grad()
def for_inference(network: ClimRT) -> ClimRT:
    """A frozen copy with batch normalisation and input scaling inside the convolutions, ClimNet in 2-D.

    The copy's state dict no longer has the authors' names; keep the original for saving.
    """
    ready = copy.deepcopy(network).eval().requires_grad_(False)
    _fold_input(ready.backbone)
    layers = [getattr(ready.backbone, f"layer{i}") for i in range(1, 6)]
    for layer in [*layers, ready.grader.conv1, ready.grader.conv2, ready.grader.conv3]:
        layer[0] = fuse_conv_bn_eval(layer[0], layer[1])
        layer[1] = nn.Identity()
    if ready.internet is not None:
        ready.internet = FoldedClimNet(ready.internet).to(next(network.parameters()).device)
    return ready.to(memory_format=torch.channels_last)


def _fold_input(backbone: Backbone) -> None:
    # The first convolution has no padding, so (x - mean) * scale can move into its weights exactly.
    conv = backbone.layer1[0]
    conv.bias -= backbone.mean * backbone.scale * conv.weight.sum((1, 2, 3))
    conv.weight *= backbone.scale
    backbone.mean, backbone.scale = 0.0, 1.0
