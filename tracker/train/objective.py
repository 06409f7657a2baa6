"""From a batch of patches to one loss and the figures worth a curve."""

from __future__ import annotations

import random

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.attention import SDPBackend, sdpa_kernel

from tracker.configs import NetworkConfig
from tracker.network.climrt import ClimRT
from tracker.train.config import Stage, StageKind, TrainConfig
from tracker.train.dataset import Batch
from tracker.train.losses import CLS_WEIGHT, LOC_WEIGHT, decode_corners, loc_loss
from tracker.train.siamese import SiameseResponse, siamese_loss


def to_input(patches: Tensor, device: torch.device) -> Tensor:
    """uint8 (B,H,W,3) to float (B,3,H,W), channels last in memory."""
    return patches.to(device, non_blocking=True).permute(0, 3, 1, 2).float()


def prime(network: ClimRT) -> None:
    """A start from which a short training succeeds; the architecture is untouched.

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


def cls1_loss_hard(logits: Tensor, target: Tensor, hard: int = 24) -> Tensor:
    """As the paper's L_cls1, but the background half is the hardest cells of each patch, not random ones."""
    log_p = functional.log_softmax(logits.float(), 1)
    label = target[:, 0]
    positive = (label == 1).float()
    pull = (-log_p[:, 1] * positive).sum() / positive.sum().clamp(min=1)
    background = (label == 0) | (label == -1)
    push = (-log_p[:, 0]).masked_fill(~background, 0).flatten(1).topk(hard, 1).values.mean()
    return 0.5 * (pull + push)


class Objective:
    """Loss of one batch for the stage at hand."""

    def __init__(self, config: TrainConfig, network: ClimRT, response: SiameseResponse, device: torch.device) -> None:
        self.config, self.network, self.response, self.device = config, network, response, device
        self._dice = random.Random(config.seed)

    def __call__(self, stage: Stage, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """The loss to descend and its parts, for a batch of tracker.train.dataset."""
        if stage.kind is StageKind.CLIMNET:
            return self._climnet(batch)
        network = self.network
        box, positive = batch["box"].to(self.device), batch["positive"].to(self.device).float()
        with torch.autocast(self.device.type, torch.bfloat16), sdpa_kernel(SDPBackend.MATH):
            zf = network.template(to_input(batch["template"], self.device))
            xf = network.features(to_input(batch["search"], self.device))
            responses = self.response(xf[-2:], zf[-2:])
            if stage.kind is StageKind.JOINT:
                predictions = network.heads(xf, zf, self._latent(stage, batch, xf))
        auxiliary = siamese_loss(responses, box, positive, self.config.cross_negative_weight)
        if stage.kind is StageKind.BACKBONE:
            return auxiliary, {"siamese": auxiliary.item()}
        target = {k: batch[f"label_{k}"].to(self.device) for k in ("cls1", "loc", "cls2", "loc_weight")}
        one = cls1_loss_hard(predictions.cls1, target["cls1"])
        two = functional.binary_cross_entropy_with_logits(predictions.cls2.float(), target["cls2"])
        loc = loc_loss(predictions.loc.float(), target["loc"], target["loc_weight"])
        total = LOC_WEIGHT * loc + CLS_WEIGHT * (one + two) + self.config.auxiliary_weight * auxiliary
        parts = {"loc": loc.item(), "cls1": one.item(), "cls2": two.item(), "siamese": auxiliary.item()}
        return total, parts

    def _latent(self, stage: Stage, batch: Batch, xf: tuple[Tensor, Tensor]) -> Tensor:
        """Layer 5 of what stands for the latent frame: the previous patch, or the current one."""
        if self._dice.random() >= stage.latent_previous_frac:
            return xf[-1]
        modes = [(m, m.training) for m in self.network.backbone.modules()]
        self.network.backbone.eval()  # its statistics belong to search patches that also learn
        with torch.no_grad():
            latent = self.network.features(to_input(batch["previous"], self.device))[-1]
        for module, training in modes:
            module.training = training
        return latent

    def _climnet(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        pad = (0, 1, 0, 1)
        frames = [functional.pad(to_input(batch[k], self.device), pad) / 255 for k in ("previous", "search", "middle")]
        with torch.autocast(self.device.type, torch.bfloat16):
            latent = self.network.internet(frames[0], frames[1])
        error = latent.float()[..., :287, :287] - frames[2][..., :287, :287]
        loss = error.abs().mean()
        psnr = -10 * torch.log10(error.square().mean((1, 2, 3)).clamp(min=1e-9)).mean()
        return loss, {"l1": loss.item(), "psnr_db": psnr.item()}


@torch.no_grad()
def validate(network: ClimRT, batches: list[Batch], device: torch.device) -> dict[str, float]:
    """Hit rate (centre within 14 px of 287), mean IoU and score separation on held-out batches."""
    network.eval()
    hits, ious, count = 0.0, 0.0, 0.0
    for batch in batches:
        zf = network.template(to_input(batch["template"], device))
        xf = network.features(to_input(batch["search"], device))
        latent = network.features(to_input(batch["previous"], device))[-1]
        loc, cls1, cls2 = network.heads(xf, zf, latent)
        score = cls1.softmax(1)[:, 1].flatten(1) * 0.8 + 0.9 * cls2.flatten(1).sigmoid()
        best = score.argmax(1)
        chosen = decode_corners(loc)[torch.arange(len(best)), best]
        box, positive = batch["box"].to(device), batch["positive"].to(device)
        middle = ((chosen[:, :2] + chosen[:, 2:]) - (box[:, :2] + box[:, 2:])) / 2
        size = (torch.minimum(chosen[:, 2:], box[:, 2:]) - torch.maximum(chosen[:, :2], box[:, :2])).clamp(min=0)
        inter = size.prod(1)
        union = (chosen[:, 2:] - chosen[:, :2]).prod(1) + (box[:, 2:] - box[:, :2]).prod(1) - inter
        hits += ((middle.norm(dim=1) < 14) & positive).sum().item()
        ious += ((inter / union.clamp(min=1)) * positive).sum().item()
        count += positive.sum().item()
    return {"hit_rate": hits / max(count, 1), "mean_iou": ious / max(count, 1)}


def initial_network(config: NetworkConfig, seed: int) -> ClimRT:
    """A freshly drawn network ready for training from scratch."""
    torch.manual_seed(seed)
    network = ClimRT(config)
    prime(network)
    return network
