"""From a batch of patches to one loss and the figures worth a curve."""

from __future__ import annotations

import random

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.attention import SDPBackend, sdpa_kernel

from tracker.network.climnet import STRIDE as CLIMNET_STRIDE
from tracker.network.climrt import ClimRT
from tracker.network.heads import Predictions
from tracker.train.config import Stage, StageKind, TrainConfig
from tracker.train.dataset import Batch
from tracker.train.devices import in_bf16
from tracker.train.losses import CLS_WEIGHT, EDGE_WEIGHT, LOC_WEIGHT, edge_loss, loc_loss
from tracker.train.siamese import SiameseResponse, siamese_loss


def to_input(patches: Tensor, device: torch.device) -> Tensor:
    """uint8 (B,H,W,3) to float (B,3,H,W), channels last in memory."""
    return patches.to(device, non_blocking=True).permute(0, 3, 1, 2).float()


def cls1_loss_hard(logits: Tensor, target: Tensor, hard: int = 24) -> Tensor:
    """As the paper's L_cls1, but the background half is the hardest cells of each patch, not random ones."""
    log_p = functional.log_softmax(logits.float(), 1)
    label = target[:, 0]
    positive = (label == 1).float()
    pull = (-log_p[:, 1] * positive).sum() / positive.sum().clamp(min=1)
    background = (label == 0) | (label == -1)
    push = (-log_p[:, 0]).masked_fill(~background, 0).flatten(1).topk(hard, 1).values.mean()
    return 0.5 * (pull + push)


def heads_loss(predictions: Predictions, batch: Batch) -> tuple[Tensor, dict[str, float]]:
    """Weighted sum of the three losses of a batch, and each of them."""
    device = predictions.loc.device
    target = {k: batch[f"label_{k}"].to(device) for k in ("cls1", "loc", "cls2", "loc_weight")}
    one = cls1_loss_hard(predictions.cls1, target["cls1"])
    two = functional.binary_cross_entropy_with_logits(predictions.cls2.float(), target["cls2"])
    loc = loc_loss(predictions.loc.float(), target["loc"], target["loc_weight"])
    edge = edge_loss(predictions.loc.float(), target["loc"], target["loc_weight"])
    parts = {"loc": loc.item(), "edge": edge.item(), "cls1": one.item(), "cls2": two.item()}
    return LOC_WEIGHT * loc + CLS_WEIGHT * (one + two) + EDGE_WEIGHT * edge, parts


class Objective:
    """Loss of one batch for the stage at hand."""

    def __init__(self, config: TrainConfig, network: ClimRT, response: SiameseResponse, device: torch.device) -> None:
        self.config, self.network, self.response, self.device = config, network, response, device
        self.bf16 = in_bf16(config.precision, device)
        self._dice = random.Random(config.seed)

    @property
    def dice_state(self) -> tuple:
        """State of the draws between kinds of latent frames, for checkpoints."""
        return self._dice.getstate()

    @dice_state.setter
    def dice_state(self, state: tuple) -> None:
        self._dice.setstate(state)

    def __call__(self, stage: Stage, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """The loss to descend and its parts, for a batch of tracker.train.dataset."""
        if stage.kind is StageKind.CLIMNET:
            return self._climnet(batch, stage.patch_px)
        network = self.network
        box, positive = batch["box"].to(self.device), batch["positive"].to(self.device).float()
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16), sdpa_kernel(SDPBackend.MATH):
            zf = network.template(to_input(batch["template"], self.device))
            xf = network.features(to_input(batch["search"], self.device))
            if stage.kind is not StageKind.HEADS:  # a backbone that keeps still has nothing to learn from it
                responses = self.response(xf[-2:], zf[-2:])
            if stage.kind is not StageKind.BACKBONE:
                predictions = network.heads(xf, zf, self._latent(stage, batch, xf))
        auxiliary = torch.zeros((), device=self.device)
        if stage.kind is not StageKind.HEADS:
            auxiliary = siamese_loss(responses, box, positive, self.config.cross_negative_weight)
        if stage.kind is StageKind.BACKBONE:
            return auxiliary, {"siamese": auxiliary.item()}
        loss, parts = heads_loss(predictions, batch)
        total = loss + self.config.auxiliary_weight * auxiliary
        return total, parts | {"siamese": auxiliary.item()}

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

    def _climnet(self, batch: Batch, patch_px: int = 0) -> tuple[Tensor, dict[str, float]]:
        """Mean absolute error of the drawn middle frame, on random crops of patch_px (0: the whole patches)."""
        frames = [to_input(f, self.device) / 255 for f in self._cropped(batch, patch_px)]
        height, width = frames[0].shape[2:]
        pad = (0, -width % CLIMNET_STRIDE, 0, -height % CLIMNET_STRIDE)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16):
            latent = self.network.internet(functional.pad(frames[0], pad), functional.pad(frames[1], pad))
        error = latent.float()[..., :height, :width] - frames[2]
        loss = error.abs().mean()
        psnr = -10 * torch.log10(error.square().mean((1, 2, 3)).clamp(min=1e-9)).mean()
        return loss, {"l1": loss.item(), "psnr_db": psnr.item()}

    def _cropped(self, batch: Batch, patch_px: int) -> list[Tensor]:
        """previous, search and middle, cut alike where they are larger than asked for."""
        frames = [batch[k] for k in ("previous", "search", "middle")]
        height, width = frames[0].shape[1:3]
        if not patch_px or patch_px >= min(height, width):
            return frames
        top, left = self._dice.randint(0, height - patch_px), self._dice.randint(0, width - patch_px)
        return [f[:, top : top + patch_px, left : left + patch_px] for f in frames]
