"""How good the network is on pictures it never learned from: the figures a run is steered and chosen by."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tracker.box import Box
from tracker.configs import LatentProvider
from tracker.eval.ope import mean_score, score
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.folded import FoldedClimNet
from tracker.online import ClimRTTracker
from tracker.train.clips import Pair, Triplet, TruthClip, adjacent_triplets, relocalisation_pairs, tracked_clips
from tracker.train.compose import Composer, Recipe
from tracker.train.config import StageKind, TrainConfig
from tracker.train.dataset import Batch, collate
from tracker.train.export import TRAINED
from tracker.train.losses import decode_corners
from tracker.train.objective import to_input
from tracker.train.pack import Imagery
from tracker.train.siamese import CELLS, STRIDE_PX

HIT_PX = 14.0  # of a composed sample's 287 px patch
# 14 of 207 px, as the pilot's table has it (training.md). With offsets of up to 64 px chance hits 7.2 %.
RELOCALISATION_PX = 14.0 * 287 / 207
GAPS = (5, 20)  # frames
MIDDLE_PX = 143.0
EXAM_BATCH = 32
STILL_DB = 60.0  # frames more alike than this count as this alike
# What each stage's score is the mean of; figures that the pictures do not allow are left out.
CHOSEN_BY = {
    StageKind.BACKBONE: (("hit_rate",), ("relocalisation_5", "relocalisation_20")),
    StageKind.CLIMNET: (("psnr_gain_db",),),
}
CHOSEN_BY_TRACKING = (("mean_iou",), ("relocalisation_5", "relocalisation_20"), ("clip_auc",))


@dataclass(frozen=True, slots=True)
class Found:
    """Best cells of a batch: corners x1,y1,x2,y2 (B,4) in search px, and scores (B,121)."""

    corners: Tensor
    scores: Tensor


class Examiner:
    """The same held-out pictures every time; deterministic for the configuration's seed."""

    def __init__(self, held_out: Imagery, config: TrainConfig) -> None:
        self.samples = _exam_batches(held_out, config)
        self._pairs = {gap: relocalisation_pairs(held_out, gap, config.seed) for gap in GAPS}
        self._clips = tracked_clips(held_out)
        self.triplets = adjacent_triplets(held_out)

    @torch.no_grad()
    def examine(self, network: ClimRT, stage_kind: StageKind, device: torch.device) -> dict[str, float]:
        """Figures by name, those that the stage trains for; the network is left as it was.

        hit_rate, mean_iou: composed samples. relocalisation_5, _20: share of targets found again after so many
        frames. clip_auc, clip_precision: the online tracker on held-out clips. psnr_db: of the latent frame,
        psnr_copy_db and psnr_mean_db: of the previous frame and of the mean of both, psnr_gain_db: over the
        better of these two.
        """
        was_training = network.training
        network.eval()
        try:
            if stage_kind is StageKind.CLIMNET:
                return latent_figures(network, self.triplets, device)
            plain = stage_kind is StageKind.BACKBONE
            figures = sample_figures(network, self.samples, device, plain=plain)
            for gap, pairs in self._pairs.items():
                if pairs:
                    figures[f"relocalisation_{gap}"] = relocalisation(network, pairs, device, plain=plain)
            return figures if plain else figures | tracking_figures(network, self._clips)
        finally:
            network.train(was_training)

    def score(self, figures: Mapping[str, float], stage_kind: StageKind) -> float:
        """What the best checkpoint is chosen by, higher is better; -inf where no figure says anything.

        Backbone: mean of hit rate and relocalisation. ClimNet: dB over the better of copy and mean. Else: mean
        of mean IoU, relocalisation and the clips' AUC, which err in different ways.
        """
        groups = [
            [figures[name] for name in names if name in figures]
            for names in CHOSEN_BY.get(stage_kind, CHOSEN_BY_TRACKING)
        ]
        means = [float(np.mean(group)) for group in groups if group]
        value = float(np.mean(means)) if means else -math.inf
        return value if math.isfinite(value) else -math.inf


def _exam_batches(held_out: Imagery, config: TrainConfig) -> list[Batch]:
    if not len(held_out):
        return []
    composer = Composer(held_out, 20_000 + config.seed, Recipe(**config.recipe))
    return [collate(composer, EXAM_BATCH) for _ in range(max(1, config.validation_samples // EXAM_BATCH))]


# -- composed samples and pairs --------------------------------------------------------------------------


def find(network: ClimRT, template: Tensor, search: Tensor, previous: Tensor | None = None) -> Found:
    """The best cell of each search patch by score alone. Patches (B,3,S,S) BGR 0..255.

    previous: the patch that stands for the latent frame; the search patch itself where there is none.
    """
    zf, xf = network.template(template), network.features(search)
    latent5 = xf[-1] if previous is None else network.features(previous)[-1]
    loc, cls1, cls2 = network.heads(xf, zf, latent5)
    probability, closeness = cls1.softmax(1)[:, 1].flatten(1), cls2.flatten(1).sigmoid()
    scores = 0.5 * (TRAINED.cls1_weight * probability + TRAINED.cls2_weight * closeness)
    corners = decode_corners(loc)
    return Found(corners[torch.arange(len(corners), device=corners.device), scores.argmax(1)], scores)


def find_plain(network: ClimRT, template: Tensor, search: Tensor) -> Tensor:
    """Centres (B,2) px where the plain correlation of layers 4 and 5, each put to one scale, is highest."""
    zf, xf = network.template(template)[-2:], network.features(search)[-2:]
    total = torch.zeros(len(search), CELLS * CELLS, device=search.device)
    for x, z in zip(xf, zf, strict=True):
        batch, channels = x.shape[:2]
        response = functional.conv2d(x.reshape(1, batch * channels, *x.shape[2:]), z, groups=batch)
        flat = response[0].flatten(1).float()
        total += (flat - flat.mean(1, keepdim=True)) / flat.std(1, keepdim=True).clamp(min=1e-6)
    best = total.argmax(1)
    cells = torch.stack([best % CELLS, best // CELLS], 1)
    return MIDDLE_PX + (cells - CELLS // 2).float() * STRIDE_PX


def sample_figures(
    network: ClimRT, batches: Iterable[Batch], device: torch.device, *, plain: bool = False
) -> dict[str, float]:
    """Hit rate (centre within 14 px of 287) and mean IoU on composed samples; plain: by the backbone alone."""
    hits, ious, count = 0.0, 0.0, 0
    for batch in batches:
        inputs = {k: to_input(batch[k], device) for k in ("template", "search", "previous")}
        box, positive = batch["box"].to(device), batch["positive"].to(device)
        if plain:
            centres = find_plain(network, inputs["template"], inputs["search"])
        else:
            corners = find(network, **inputs).corners
            centres = (corners[:, :2] + corners[:, 2:]) / 2
            ious += (_iou(corners, box) * positive).sum().item()
        error = (centres - (box[:, :2] + box[:, 2:]) / 2).norm(dim=1)
        hits += ((error < HIT_PX) & positive).sum().item()
        count += int(positive.sum())
    if not count:
        return {}
    return {"hit_rate": hits / count} | ({} if plain else {"mean_iou": ious / count})


def _iou(a: Tensor, b: Tensor) -> Tensor:
    inter = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(1)
    union = (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - inter
    return inter / union.clamp(min=1)


def relocalisation(network: ClimRT, pairs: list[Pair], device: torch.device, *, plain: bool = False) -> float:
    """Share of pairs whose target's centre is found within 19.4 px of the search patch. pairs: one at least."""
    hits = 0.0
    for some in _slices(pairs, EXAM_BATCH):
        template = to_input(torch.from_numpy(np.stack([p.template for p in some])), device)
        search = to_input(torch.from_numpy(np.stack([p.search for p in some])), device)
        if plain:
            centres = find_plain(network, template, search)
        else:
            corners = find(network, template, search).corners
            centres = (corners[:, :2] + corners[:, 2:]) / 2
        truth = torch.tensor([p.centre_px for p in some], device=device)
        hits += ((centres - truth).norm(dim=1) <= RELOCALISATION_PX).sum().item()
    return hits / len(pairs)


def _slices(pairs: list[Pair], size: int) -> Iterator[list[Pair]]:
    return (pairs[i : i + size] for i in range(0, len(pairs), size))


# -- clips ------------------------------------------------------------------------------------------------


def tracking_figures(network: ClimRT, clips: list[TruthClip]) -> dict[str, float]:
    """Success AUC and precision at 20 px of the online tracker, over the frames where the target is there."""
    if not clips:
        return {}
    tracker = ClimRTTracker(network, TRAINED if _uses_latent(network) else replace(TRAINED, latent=LatentProvider.OFF))
    mean = mean_score(score(follow(tracker, clip), clip.truth_xywh) for clip in clips)
    return {"clip_auc": mean.auc_valid, "clip_precision": mean.precision_valid}


def _uses_latent(network: ClimRT) -> bool:
    return network.config.variant.uses_latent


def follow(tracker: ClimRTTracker, clip: TruthClip) -> np.ndarray:
    """The tracker's boxes (N,4) x,y,w,h px; the first one is given."""
    tracker.init(clip.images[0], Box.from_xywh(*clip.truth_xywh[0]))
    found = [tracker.update(clip.images[i]).box.xywh for i in range(1, len(clip))]
    return np.array([tuple(clip.truth_xywh[0]), *found])


def latent_figures(network: ClimRT, triplets: list[Triplet], device: torch.device) -> dict[str, float]:
    """PSNR in dB of the latent frame against the true one, and of the two ways to do without ClimNet."""
    if network.internet is None or not triplets:
        return {}
    climnet, rows = FoldedClimNet(network.internet).to(device), []  # the same numbers, six times as fast
    for trio in triplets:
        previous, middle, current = (to_input(torch.from_numpy(p)[None], device) for p in trio)
        latent = latent_patch(climnet, previous, current)
        rows.append([psnr_db(guess, middle) for guess in (latent, previous, (previous + current) / 2)])
    drawn, copy, mean = (float(v) for v in np.mean(rows, 0))
    gain = drawn - max(copy, mean)
    return {"psnr_db": drawn, "psnr_copy_db": copy, "psnr_mean_db": mean, "psnr_gain_db": gain}


def psnr_db(guess: Tensor, truth: Tensor) -> float:
    """Peak signal-to-noise ratio of grey levels 0..255, at most 60 dB; not a number where the guess is none."""
    error = (guess.float() - truth.float()).square().mean().item() / 255**2
    if math.isnan(error):
        return error
    return min(STILL_DB, -10 * math.log10(max(error, 1e-12)))
