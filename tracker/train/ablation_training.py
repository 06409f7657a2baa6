"""Brief, equal training of the ablations: what they share is computed once, and shown to all in the same order."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.attention import SDPBackend, sdpa_kernel

from tracker.configs import NetworkConfig, Variant
from tracker.network.backbone import Features
from tracker.network.climrt import ClimRT
from tracker.train.ablation_config import AblationConfig
from tracker.train.config import Stage, TrainConfig
from tracker.train.dataset import Batch, batches, triplet_batches
from tracker.train.devices import in_bf16
from tracker.train.objective import Objective, heads_loss, to_input
from tracker.train.pack import Imagery
from tracker.train.priming import initial_network
from tracker.train.schedule import cosine_factor, make_optimizer, set_modes
from tracker.train.siamese import SiameseResponse
from tracker.weights import DATA, load_network

OnStep = Callable[[], object]
CPU = torch.device("cpu")
GRADIENT_CLIP = 5.0


def shared_backbone(start_from: str) -> tuple[NetworkConfig, dict[str, Tensor]]:
    """Widths, without ClimNet, and the backbone's tensors of a weights file or shipped name. Raises WeightsError."""
    path = Path(start_from)
    network = load_network(path if path.suffix == ".safetensors" else DATA / f"{start_from}.safetensors")
    return replace(network.config, climnet=None, variant=Variant.FULL), network.backbone.state_dict()


class Learner:
    """One variant's transformer and heads on the shared backbone, freshly drawn, and who changes them."""

    def __init__(self, config: NetworkConfig, backbone: dict[str, Tensor], training: TrainConfig) -> None:
        self.network = initial_network(config, training.seed)
        self.network.backbone.load_state_dict(backbone)
        self.network.to(memory_format=torch.channels_last)
        self.optimizer = _prepare(self.network, training.stages[0], training)
        self._bf16 = in_bf16(training.precision, CPU)

    def step(self, template: Features, search: Features, latent5: Tensor, batch: Batch, rate: float) -> None:
        """Learn from one batch's features of layers 3, 4 and 5."""
        layers = slice(None) if self.network.config.variant.is_hift else slice(-2, None)
        with torch.autocast("cpu", torch.bfloat16, enabled=self._bf16), sdpa_kernel(SDPBackend.MATH):
            predictions = self.network.heads(search[layers], template[layers], latent5)
        _descend(self.optimizer, heads_loss(predictions, batch)[0], rate)


@torch.no_grad()
def _features(eyes: ClimRT, batch: Batch, latent: str) -> tuple[Features, Features, Tensor]:
    """Layers 3, 4 and 5 of template and search patch, layer 5 of the patch that stands for the latent frame."""
    template, search, between = (eyes.features(to_input(batch[key], CPU)) for key in ("template", "search", latent))
    return template, search, between[-1]


def train_graders(
    config: AblationConfig, seed: int, kinds: Sequence[Variant], imagery: Imagery, on_step: OnStep
) -> dict[Variant, ClimRT]:
    """Networks of the kinds, trained side by side on the same samples; in eval mode. on_step: after each batch."""
    widths, backbone = shared_backbone(config.start_from)
    training = config.training(seed)
    stage = training.stages[0]
    learners = [Learner(widths.as_variant(kind), backbone, training) for kind in kinds]
    eyes = ClimRT(widths.as_variant(Variant.HIFT)).eval()  # HiFT's backbone gives all three layers
    eyes.backbone.load_state_dict(backbone)
    eyes.to(memory_format=torch.channels_last)
    source = batches(imagery, training.recipe_of(stage), stage.batch, seed, config.workers, middle=True)
    dice = random.Random(seed)
    bf16 = in_bf16(training.precision, CPU)
    for step in range(stage.steps):
        batch = next(source)
        latent = "previous" if dice.random() < config.latent_previous_frac else "middle"
        rate = stage.learning_rate * cosine_factor(step / stage.steps, step, config.warmup_steps)
        with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            features = _features(eyes, batch, latent)
        for learner in learners:
            learner.step(*features, batch, rate)
        on_step()
    return {kind: learner.network.eval() for kind, learner in zip(kinds, learners, strict=True)}


def train_climnet(config: AblationConfig, seed: int, design: Variant, imagery: Imagery, on_step: OnStep) -> ClimRT:
    """A network whose ClimNet, of the variant's blocks, has learned for the configured samples; in eval mode."""
    widths, _ = shared_backbone(config.start_from)
    training = config.training(seed)
    stage = training.stages[1]
    network = initial_network(replace(widths, climnet=config.climnet).as_variant(design), seed)
    optimizer = _prepare(network, stage, training)
    objective = Objective(training, network, SiameseResponse(widths.backbone_channels[3:]), CPU)
    recipe, side_px = training.recipe_of(stage), stage.patch_px
    source = triplet_batches(imagery, recipe, stage.batch, seed, config.workers, patch_px=side_px)
    for step in range(stage.steps):
        rate = stage.learning_rate * cosine_factor(step / stage.steps, step, config.warmup_steps)
        _descend(optimizer, objective(stage, next(source))[0], rate)
        on_step()
    return network.eval()


def _prepare(network: ClimRT, stage: Stage, training: TrainConfig) -> torch.optim.Optimizer:
    response = SiameseResponse(network.config.backbone_channels[3:])  # has no part in these stages
    set_modes(stage, network, response)
    return make_optimizer(stage, training, network, response)


def _descend(optimizer: torch.optim.Optimizer, loss: Tensor, rate: float) -> None:
    """One step; one whose gradients are not finite is left out."""
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    for group in optimizer.param_groups:
        group["lr"] = rate
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    if torch.isfinite(torch.nn.utils.clip_grad_norm_(parameters, GRADIENT_CLIP)):
        optimizer.step()
