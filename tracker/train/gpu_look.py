"""Light, sensor and codec of a batch: the template by itself, the frames of the moment together."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from tracker.train import gpu_photometric as photometric
from tracker.train.compose import Recipe
from tracker.train.gpu_photometric import Tone
from tracker.train.gpu_random import Dice

GREY_FRAC, FOG_FRAC, BLUR_FRAC, NOISE_FRAC, CODEC_FRAC = 0.12, 0.1, 0.2, 0.4, 0.2


def look(dice: Dice, recipe: Recipe, template: Tensor, moment: Tensor, pan: Tensor) -> tuple[Tensor, Tensor]:
    """template (B,3,127,127) and moment (B,F,3,287,287) as a camera gives them, 0..1.

    pan (B,2): the ground's shift from frame to frame, px; blur lies along it. Both are written over.
    """
    size = len(template)
    rows = dice.some(recipe.coarse_frac, size)
    factor = dice.uniform(0.22, 0.8, len(rows))
    other = (factor * dice.normal(0.15, len(rows)).exp()).clamp(0.2, 1)
    template = _on(template, rows, lambda p: photometric.coarsen(p, other))
    moment = _on(moment, rows, lambda p: photometric.coarsen(p, _each(factor, p)))

    template = Tone.drawn(dice, size)(template)
    light = Tone.drawn(dice, size)
    frames = moment.shape[1]
    light = Tone(*(v.repeat_interleave(frames, 0) for v in (light.gamma, light.gain, light.bias)))
    moment = light(moment.flatten(0, 1)).unflatten(0, (size, frames))

    rows = dice.some(GREY_FRAC, size)
    template, moment = (_on(p, rows, photometric.grey) for p in (template, moment))
    rows = dice.some(FOG_FRAC, size)
    fog = dice.uniform(0.05, 0.4, len(rows))
    moment = _on(moment, rows, lambda p: photometric.haze(p, _each(fog, p)))
    rows = dice.some(BLUR_FRAC, size)
    length, along = dice.uniform(3, 9.5, len(rows)), torch.atan2(pan[rows, 1], pan[rows, 0])
    moment = _on(moment, rows, lambda p: photometric.motion_blur(p, _each(length, p), _each(along, p)))

    template = _noisy(dice, template)
    moment = _noisy(dice, moment.flatten(0, 1)).unflatten(0, (size, frames))
    rows = dice.some(CODEC_FRAC, size)
    quality = dice.uniform(15, 70, len(rows))
    moment = _on(moment, rows, lambda p: photometric.compress(p, _each(quality, p)))
    half = (len(rows) + 1) // 2
    template = _on(template, rows[:half], lambda p: photometric.compress(p, quality[:half]))
    return template, moment


def to_bytes(patches: Tensor) -> Tensor:
    """(...,3,H,W) 0..1 to (...,H,W,3) uint8."""
    return (patches * 255).round_().clamp_(0, 255).to(torch.uint8).movedim(-3, -1).contiguous()


def _each(values: Tensor, patches: Tensor) -> Tensor:
    """Values of samples (N,) repeated for their frames."""
    return values.repeat_interleave(len(patches) // max(len(values), 1), 0)


def _on(batch: Tensor, rows: Tensor, change: Callable[[Tensor], Tensor]) -> Tensor:
    """The batch, (B,3,H,W) or (B,F,3,H,W), with some of its rows changed; frames go through as samples."""
    if not len(rows):
        return batch
    some = batch[rows]
    return batch.index_copy_(0, rows, change(some.flatten(0, -4)).reshape(some.shape))


def _noisy(dice: Dice, patches: Tensor) -> Tensor:
    rows = dice.some(NOISE_FRAC, len(patches))
    sigma = dice.uniform(1, 9, len(rows), 1, 1, 1) / 255
    noise = dice.normal(1, len(rows), *patches.shape[1:]) * sigma
    return patches.index_add_(0, rows, noise).clamp_(0, 1)
