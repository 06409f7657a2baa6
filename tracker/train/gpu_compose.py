"""tracker.train.compose.Composer for whole batches on one device, with every picture resident there.

The same samples by the same recipe: only the order of random draws differs. Nothing in `batch` waits for the
device, so that composing runs beside training.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from tracker.train.compose import SEARCH_PX, TEMPLATE_PX, Recipe
from tracker.train.dataset import Batch
from tracker.train.gpu_labels import batch_labels
from tracker.train.gpu_look import look, to_bytes
from tracker.train.gpu_photometric import Tone
from tracker.train.gpu_pose import Poses, Waves
from tracker.train.gpu_random import Dice
from tracker.train.gpu_render import Ground, Sprites
from tracker.train.gpu_things import tables
from tracker.train.pack import Imagery

TOGETHER = 128  # samples: one batch costs the host some 2,500 calls, whatever its size


class View(NamedTuple):
    """How the template and the frames are seen alike: turn (B,) radians, mirrored or not (B,)."""

    angle_rad: Tensor
    flip: Tensor


@dataclass(frozen=True)
class Plan:
    """All of a batch that decides its boxes; each (B,) or a list of the frames' (B,), the last being search."""

    template_thing: Tensor
    thing: Tensor  # of the frames; another one in negatives
    positive: Tensor
    own: Tensor  # in its own picture, not pasted on another
    view: View
    target: list[Poses]
    shift: list[tuple[Tensor, Tensor]]  # of the ground, px, against search
    bend: tuple[Tensor, Waves] | None  # which samples' targets are bent, and how
    box: Tensor  # (B,4) x1, y1, x2, y2 in search px


class GpuComposer:
    """Draws batches from an Imagery copied whole to a device. Deterministic for its seed and kind of device."""

    def __init__(
        self,
        imagery: Imagery,
        device: torch.device | str,
        seed: int,
        recipe: Recipe | None = None,
        limit_bytes: int | None = None,
    ) -> None:
        """limit_bytes: memory that pictures may take; TooLargeError is raised where they need more."""
        self.device = torch.device(device)
        self.recipe = recipe or Recipe()
        self.dice = Dice(self.device, seed)
        self.atlas, self.things, self.choices = tables(imagery, self.device, seed, limit_bytes)
        self._pictures, self._levels = len(imagery), len(imagery.pyramids[0])

    def batch(self, size: int, middle: bool = False) -> Batch:
        """A batch as tracker.train.dataset.collate makes them, on the device."""
        with torch.no_grad(), torch.autocast(self.device.type, enabled=False):
            return self._batch(size, middle)

    def _batch(self, size: int, middle: bool) -> Batch:
        plan = self.plan(size, (0.0, 0.5, 1.0) if middle else (0.0, 1.0))
        template, moment = self._template(plan), self._moment(plan)
        template, moment = look(self.dice, self.recipe, template, moment, torch.stack(plan.shift[0], 1))
        frames = to_bytes(moment)
        batch = {"template": to_bytes(template), "previous": frames[:, 0].contiguous()}
        batch |= {"search": frames[:, -1].contiguous(), "box": plan.box, "positive": plan.positive}
        batch |= batch_labels(plan.box, plan.positive, self.dice)
        if middle:
            batch["middle"] = frames[:, 1].contiguous()
        return batch

    # -- placing --------------------------------------------------------------------------------------

    def _poses(self, thing: Tensor, size_px: int, view: View, shift: tuple[Tensor, Tensor], wide: float) -> Poses:
        """Where things lie in patches: their 127 px context scaled, jittered by `wide`."""
        dice, r, n = self.dice, self.recipe, len(thing)
        scale = TEMPLATE_PX / self.things.context[thing] * dice.normal(r.scale_std * wide, n).exp()
        aspect = dice.normal(r.aspect_std * wide, n).exp()
        turn = view.angle_rad + dice.normal(r.rotation_std_rad * wide, n)
        c, shear = (size_px - 1) / 2, dice.normal(0.06 * wide, n)
        return Poses(c + shift[0], c + shift[1], scale * aspect, scale / aspect, turn, shear, view.flip)

    def _grounds(self, size: int, size_px: int) -> tuple[Tensor, Tensor, Poses]:
        """Pictures (B,), points of them (B,2) px, and poses that fill patches with some room to pan."""
        dice = self.dice
        picture = self.choices.grounds(dice, size, self._pictures)
        texture = picture * self._levels
        sides = torch.stack([self.atlas.width[texture], self.atlas.height[texture]], 1).float()
        scale = size_px * 1.25 / sides.amin(1) * dice.uniform(0, 1.2, size).exp()
        room = (sides - 1.2 * size_px / scale[:, None]).clamp(min=0) / 2
        anchor = sides / 2 + room * dice.uniform(-1, 1, size, 2)
        angle = torch.where(dice.chance(0.3, size), dice.angle(size), dice.normal(0.1, size))
        middle = torch.full_like(scale, (size_px - 1) / 2)
        poses = Poses(middle, middle, scale, scale, angle, torch.zeros_like(scale), dice.chance(0.5, size))
        return picture, anchor, poses

    def plan(self, size: int, times: tuple[float, ...]) -> Plan:
        """Draw things, views and motions; times: 0 = previous frame .. 1 = search frame."""
        dice, r = self.dice, self.recipe
        template_thing, thing = self.choices.pairs(dice, size, r.clip_frac, r.spot_frac)
        positive = ~dice.chance(r.negative_frac, size)
        thing = torch.where(positive, thing, self.choices.any_thing(dice, size))
        own = dice.chance(r.own_background_frac, size) & self.things.covers[thing]
        turned = dice.chance(r.any_rotation_frac, size)
        view = View(torch.where(turned, dice.angle(size), dice.normal(0.1, size)), dice.chance(0.5, size))
        target, shift = self._motion(thing, view, own, times)
        bend, hull = self._bend(thing, own), self.things.hull[thing]
        if bend is not None:
            hull = hull.index_copy(0, bend[0], bend[1].bent(hull[bend[0]]))
        return Plan(template_thing, thing, positive, own, view, target, shift, bend, target[-1].boxes(hull))

    def _motion(
        self, thing: Tensor, view: View, own: Tensor, times: tuple[float, ...]
    ) -> tuple[list[Poses], list[tuple[Tensor, Tensor]]]:
        """The targets' poses and the grounds' shifts, per frame."""
        dice, r, n = self.dice, self.recipe, len(thing)
        near = dice.normal(14, 2, n)
        shift = torch.where(dice.chance(0.7, n), dice.uniform(-r.shift_px, r.shift_px, 2, n), near)
        now = self._poses(thing, SEARCH_PX, view, (shift[0], shift[1]), 1.0)
        motion = dice.normal(9, 2, n) + shift * dice.uniform(0, 1, n)
        before = now.moved(-motion[0], -motion[1], dice.normal(0.03, n).exp(), dice.normal(0.05, n))
        pan = torch.where(own, -motion, dice.normal(6, 2, n))
        shifts = [((1 - t) * pan[0], (1 - t) * pan[1]) for t in times]
        return [before.towards(now, t) for t in times], shifts

    # -- drawing --------------------------------------------------------------------------------------

    def _sprites(self, thing: Tensor, opacity: Tensor | None = None, **kinds: object) -> Sprites:
        opacity = torch.ones(len(thing), device=self.device) if opacity is None else opacity
        first = self._pictures * self._levels
        return Sprites.of(self.atlas, self.things, first, thing, opacity, **kinds)

    def _template(self, plan: Plan) -> Tensor:
        """Patches (B,3,127,127): the thing where it is, or pasted on another background."""
        dice, thing, n = self.dice, plan.template_thing, len(plan.thing)
        moved = ~plan.own & dice.chance(self.recipe.template_moved_frac, n)
        jitter = dice.normal(2.5, 2, n)  # an operator's hand
        poses = self._poses(thing, TEMPLATE_PX, plan.view, (jitter[0], jitter[1]), 0.4)
        picture, anchor, ground = self._grounds(n, TEMPLATE_PX)
        picture = torch.where(moved, picture, self.things.picture[thing])
        anchor = torch.where(moved[:, None], anchor, self.things.centre[thing])
        ground = ground.where(moved, poses)
        patches = Ground.of(self.atlas, self._levels, picture, anchor, ground, TEMPLATE_PX).seen(ground, TEMPLATE_PX)
        return self._sprites(thing, moved.float()).paste(patches, poses)

    def _moment(self, plan: Plan) -> Tensor:
        """Frames (B,F,3,287,287)."""
        thing, own = plan.thing, plan.own
        picture, anchor, backdrop = self._grounds(len(thing), SEARCH_PX)
        picture = torch.where(own, self.things.picture[thing], picture)
        anchor = torch.where(own[:, None], self.things.centre[thing], anchor)
        views = [pose.where(own, backdrop.moved(*by)) for pose, by in zip(plan.target, plan.shift, strict=True)]
        ground = Ground.of(self.atlas, self._levels, picture, anchor, views[len(views) // 2], SEARCH_PX)
        target = self._sprites(thing, (~own).float(), bend=plan.bend)
        layers = [*self._distractors(plan), *self._shadows(plan), (target, plan.target), *self._occluders(plan)]
        frames = []
        for i, view in enumerate(views):
            patches = ground.seen(view, SEARCH_PX)
            for sprites, poses in layers:
                patches = sprites.paste(patches, poses[i])
            frames.append(patches)
        return torch.stack(frames, 1)

    def _bend(self, thing: Tensor, own: Tensor) -> tuple[Tensor, Waves] | None:
        """Which targets are bent out of shape, and how; those in their own picture are not."""
        dice = self.dice
        rows = dice.some(self.recipe.deformed_frac, len(thing))
        if not len(rows):
            return None
        n = len(rows)
        amplitude = dice.uniform(-0.07, 0.07, n, 2) * ~own[rows, None]
        turn, waves = dice.uniform(-torch.pi, torch.pi, n, 2), dice.uniform(3, 7, n, 2, 1)
        frequency = waves * torch.stack([turn.cos(), turn.sin()], 2)
        phase = dice.uniform(-torch.pi, torch.pi, n, 2)
        return rows, Waves(amplitude, frequency, phase, self.things.size[thing[rows]])

    # -- what else is there: sprites, with their poses in every frame ---------------------------------

    def _distractors(self, plan: Plan) -> Iterator[tuple[Sprites, list[Poses]]]:
        """Up to three rivals a sample, on the ground; half of them the target itself in other colours."""
        dice, thing = self.dice, plan.thing
        chosen = dice.some(self.recipe.distractor_frac, len(thing))
        for share in (1.0, 2 / 3, 1 / 3):
            rows = chosen[dice.some(share, len(chosen))]
            n = len(rows)
            if not n:
                continue
            same = dice.chance(0.5, n)
            other = torch.where(same, thing[rows], self.choices.other(dice, thing[rows]))
            drawn = Tone.drawn(dice, n, 2.5)
            wide = same[:, None]
            tone = Tone(
                torch.where(same, drawn.gamma, 1.0),
                torch.where(wide, drawn.gain, 1.0),
                torch.where(wide, drawn.bias, 0.0),
            )
            order = torch.where(wide, dice.uniform(0, 1, n, 3).argsort(1), torch.arange(3, device=self.device))
            far, away = dice.uniform(45, 170, n), dice.angle(n)
            now = plan.target[-1][rows]
            size = TEMPLATE_PX / self.things.context[other] * dice.normal(0.25, n).exp()
            x, y = now.x + far * away.cos(), now.y + far * away.sin()
            still = Poses(x, y, size, size, dice.angle(n), torch.zeros_like(x), torch.zeros_like(same))
            sprites = self._sprites(other, rows=rows, tone=tone, order=order)
            yield sprites, [still.moved(dx[rows], dy[rows]) for dx, dy in plan.shift]

    def _shadows(self, plan: Plan) -> Iterator[tuple[Sprites, list[Poses]]]:
        """Targets' own shadows beside them: dark, shaped alike, moving along, and not the target."""
        dice = self.dice
        rows = dice.some(self.recipe.shadow_frac, len(plan.thing))
        n = len(rows)
        if not n:
            return
        sides = plan.box[rows, 2:] - plan.box[rows, :2]
        away, reach = dice.angle(n), dice.uniform(0.7, 1.05, n)
        x, y = reach * sides[:, 0] * away.cos(), reach * sides[:, 1] * away.sin()
        zoom = dice.uniform(0.7, 1.2, n)
        none = torch.zeros(n, 3, device=self.device)
        dark = Tone(torch.ones(n, device=self.device), none, dice.uniform(0, 40 / 255, n, 1) - 0.5 + none)
        opacity = dice.uniform(0.35, 0.85, n) * ~plan.own[rows]
        sprites = self._sprites(plan.thing[rows], opacity, rows=rows, tone=dark)
        yield sprites, [p[rows].moved(x, y, zoom, math.pi) for p in plan.target]

    def _occluders(self, plan: Plan) -> Iterator[tuple[Sprites, list[Poses]]]:
        """Pieces of other pictures over part of the target, standing on the ground."""
        dice, box = self.dice, plan.box
        rows = dice.some(self.recipe.occluder_frac, len(box))
        n = len(rows)
        if not n:
            return
        spot = self.choices.spots(dice, n)
        sides = box[rows, 2:] - box[rows, :2]
        size = dice.uniform(0.3, 0.75, n) * sides.amax(1)
        away = dice.angle(n)
        x = (box[rows, 0] + box[rows, 2]) / 2 + 0.5 * sides[:, 0] * away.cos()
        y = (box[rows, 1] + box[rows, 3]) / 2 + 0.5 * sides[:, 1] * away.sin()
        scale = size[:, None] / self.things.size[spot]
        zero = torch.zeros_like(x)
        still = Poses(x, y, scale[:, 0], scale[:, 1], zero, zero, torch.zeros_like(rows, dtype=torch.bool))
        sprites = self._sprites(spot, rows=rows)
        yield sprites, [still.moved(dx[rows], dy[rows]) for dx, dy in plan.shift]


def gpu_batches(composer: GpuComposer, size: int, middle: bool = False, together: int | None = None) -> Iterator[Batch]:
    """Endless batches, several composed at once so that at least `together` samples share the calls.

    On CUDA (where None means 128, elsewhere 1) the next ones are made on a stream of their own while the last ones
    train.
    """
    if together is None:
        together = TOGETHER if composer.device.type == "cuda" else 1
    parts = max(1, -(-together // size))
    for batch in _ahead(composer, size * parts, middle):
        for i in range(parts):
            yield {k: v[i * size : (i + 1) * size] for k, v in batch.items()}


def _ahead(composer: GpuComposer, size: int, middle: bool) -> Iterator[Batch]:
    if composer.device.type != "cuda":
        while True:
            yield composer.batch(size, middle)
    stream = torch.cuda.Stream(composer.device)
    stream.wait_stream(torch.cuda.current_stream(composer.device))  # the pictures must have arrived

    def begin() -> Batch:
        with torch.cuda.stream(stream):
            return composer.batch(size, middle)

    ahead = begin()
    while True:
        now = torch.cuda.current_stream(composer.device)
        now.wait_stream(stream)
        batch = ahead
        for tensor in batch.values():
            tensor.record_stream(now)  # its memory must not be taken again while it trains
        ahead = begin()
        yield batch
