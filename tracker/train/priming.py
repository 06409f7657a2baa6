"""Starts from which a short training succeeds; the architecture is untouched."""

from __future__ import annotations

import torch

from tracker.configs import NetworkConfig
from tracker.network.climnet import ClimNet
from tracker.network.climrt import ClimRT

GATE_BIAS = 2.0  # the gates of the channels that carry the mean begin almost open, and stay learnable
COLOURS = 3


def initial_network(config: NetworkConfig, seed: int) -> ClimRT:
    """A freshly drawn network ready for training from scratch."""
    torch.manual_seed(seed)
    network = ClimRT(config)
    prime_heads(network)
    if network.internet is not None:
        prime_climnet(network.internet)
    return network


def prime_heads(network: ClimRT) -> None:
    """Attention begins on a cell's own position, boxes begin with the size of a target.

    Queries and keys begin as the same shuffled copy of their input, so attention starts on a cell's own
    position (with positions of unit variance) instead of everywhere; boxes begin with the size a target
    has in a patch, so that predictions overlap and the IoU loss has a slope from the first step.
    """
    generator = torch.Generator().manual_seed(0)
    hidden = network.config.hidden
    for name, module in network.grader.named_modules():
        if isinstance(module, torch.nn.MultiheadAttention) and "decoder.layers.0.self_attn" not in name:
            mixed = torch.eye(hidden)[torch.randperm(hidden, generator=generator)] * 1.4
            with torch.no_grad():
                module.in_proj_weight[:hidden] = mixed
                module.in_proj_weight[hidden : 2 * hidden] = mixed
                module.in_proj_weight[2 * hidden :] = torch.eye(hidden)
    for table in (network.grader.row_embed, network.grader.col_embed):
        torch.nn.init.normal_(table.weight, std=1.0, generator=generator)
    with torch.no_grad():
        network.grader.convloc[-1].bias.fill_(0.22)


@torch.no_grad()
def prime_climnet(network: ClimNet) -> None:
    """The drawn frame begins as the mean of both, so that training has only what moves left to learn.

    Six channels of the finest skip connection carry both signs of each colour, past all that is coarser; the
    fusion takes the mean of both moments, the last convolution puts the signs together again.
    """
    encoder, width = network.encoder, 2 * COLOURS
    stem, time = encoder.stem[0].weight, encoder.stem[3].weight
    if min(len(stem), len(time)) < width:
        return  # too narrow for it: begins as drawn
    _carry(stem, 3, [(c, c, 1.0) for c in range(COLOURS)] + [(COLOURS + c, c, -1.0) for c in range(COLOURS)])
    _carry(time, 0, [(c, c, 1.0) for c in range(width)])
    finest = encoder.layer1[0]
    last = finest.conv2[0].temporalconv[0] if hasattr(finest.conv2[0], "temporalconv") else finest.conv2[0]
    last.weight[:width] = 0
    gates = [finest.fg.attn_layer[0], network.decoder[4].conv[1].attn_layer[0]]
    for gate in gates:
        gate.weight[:width] *= 0.1
        gate.bias[:width] = GATE_BIAS
    fine = network.decoder[4].conv[0]
    skip = fine.weight.shape[1] // 2  # the decoded channels come first, then the encoder's
    _carry(fine.weight, 1, [(c, skip + c, 1.0) for c in range(width)])
    fine.bias[:width] = 0
    fuse = network.feature_fuse.conv[0].weight
    moment = fuse.shape[0]
    _carry(fuse, 0, [(c, m * moment + c, 0.5) for c in range(width) for m in range(2)])
    out = network.outconv[1]
    opening = torch.sigmoid(torch.tensor(GATE_BIAS)).item() ** len(gates)
    out.weight *= 0.05
    out.bias.zero_()
    out.weight[:, :width] = 0
    for c in range(COLOURS):
        out.weight[c, c, 3, 3] = 1 / opening
        out.weight[c, COLOURS + c, 3, 3] = -1 / opening


def _carry(weight: torch.Tensor, middle: int, links: list[tuple[int, int, float]]) -> None:
    """Output channels that each carry one input channel times a factor, through the kernel's middle tap.

    weight: (out, in, ...kernel). middle: index of the middle tap in height and width.
    """
    for out, _, _ in links:
        weight[out] = 0
    taps = weight.ndim - 2
    for out, source, factor in links:
        time = (weight.shape[2] // 2,) if taps == 3 else ()
        weight[(out, source, *time, middle, middle)] = factor
