"""Batches composed on a device: the same samples as the CPU's composer, boxes where the pixels are."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tests.tracker.packs import write_pack
from tracker.train import gpu_compose, gpu_photometric, photometric
from tracker.train.compose import SEARCH_PX, Composer, Recipe
from tracker.train.dataset import collate
from tracker.train.gpu_compose import GpuComposer, gpu_batches
from tracker.train.gpu_labels import batch_labels
from tracker.train.gpu_pose import Poses
from tracker.train.gpu_random import Dice
from tracker.train.gpu_render import Ground
from tracker.train.gpu_things import Choices, TooLargeError, hull_points
from tracker.train.labels import make_labels
from tracker.train.pack import Imagery, Thing, load, pyramid_of
from tracker.train.warp import Pose, warp_around

CPU = torch.device("cpu")
# Without anything that would hide or change the red of the drawn object.
PLAIN = {
    "clip_frac": 0.0,
    "spot_frac": 0.0,
    "negative_frac": 0.0,
    "distractor_frac": 0.0,
    "occluder_frac": 0.0,
    "shadow_frac": 0.0,
    "shift_px": 40.0,
}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Imagery:
    return load([write_pack(tmp_path_factory.mktemp("drawn") / "pack")])


@pytest.fixture(scope="module")
def red() -> Imagery:
    """A red kite-like shape on a large green picture, and a picture without it to paste on."""
    rng = np.random.default_rng(0)
    first, second = (
        cv2.resize(rng.integers(0, 120, (20, 20, 3), np.uint8), (640, 640), interpolation=cv2.INTER_CUBIC)
        for _ in range(2)
    )
    first[..., 2], second[..., 2] = 0, 0
    outline = np.array([[300, 280], [340, 300], [332, 330], [290, 322]], np.float32)
    cv2.fillPoly(first, [outline.astype(np.int32)], (0, 0, 255))
    thing = Thing(0, (290.0, 280.0, 50.0, 50.0), (outline,), label="kite")
    return Imagery([pyramid_of(first), pyramid_of(second)], [], ["drawn", "drawn"], [-1, -1], [thing], [], [])


def red_box(patch: torch.Tensor) -> np.ndarray:
    """x1, y1, x2, y2 round the pixels that are more red than not."""
    ys, xs = np.nonzero(patch[..., 2].numpy() > 127)
    return np.array([xs.min(), ys.min(), xs.max(), ys.max()], float)


def without_look(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_compose, "look", lambda _dice, _recipe, template, moment, _pan: (template, moment))


def test_batches_are_as_those_of_the_worker_processes(drawn: Imagery) -> None:
    batch = GpuComposer(drawn, "cpu", 1).batch(3, middle=True)
    reference = collate(Composer(drawn, 1, middle=True), 3)
    assert {k: (v.shape, v.dtype) for k, v in batch.items()} == {k: (v.shape, v.dtype) for k, v in reference.items()}
    assert all(v.is_contiguous() for v in batch.values())


def test_batches_composed_together_are_cut_apart(drawn: Imagery) -> None:
    source = gpu_batches(GpuComposer(drawn, "cpu", 1), 2, together=3)
    first, second = next(source), next(source)
    whole = GpuComposer(drawn, "cpu", 1).batch(4)
    assert whole.keys() == first.keys()
    assert all(torch.equal(torch.cat([first[k], second[k]]), whole[k]) for k in whole)


def test_composing_never_waits_for_the_device(drawn: Imagery) -> None:
    composer, meta = GpuComposer(drawn, "cpu", 1), torch.device("meta")  # there, a look at a value raises

    def moved(table: object) -> object:
        tensors = {k: v.to(meta) for k, v in vars(table).items() if isinstance(v, torch.Tensor)}
        return dataclasses.replace(table, **tensors)

    composer.device = composer.dice.device = meta
    composer.dice._generator = None
    composer.atlas, composer.things, composer.choices = map(moved, (composer.atlas, composer.things, composer.choices))
    with torch.no_grad():
        batch = composer._batch(8, middle=True)
    assert {v.device for v in batch.values()} == {meta}  # and nothing of it was left on the host


def test_same_seed_same_batch(drawn: Imagery) -> None:
    first, again, other = (GpuComposer(drawn, "cpu", seed).batch(2) for seed in (5, 5, 6))
    assert all(torch.equal(first[k], again[k]) for k in first)
    assert not torch.equal(first["search"], other["search"])


@pytest.mark.parametrize("own", [0.0, 1.0])
@pytest.mark.parametrize("deformed", [0.0, 1.0])
def test_the_box_is_where_the_pixels_are(
    red: Imagery, monkeypatch: pytest.MonkeyPatch, own: float, deformed: float
) -> None:
    without_look(monkeypatch)
    monkeypatch.setattr(Choices, "grounds", lambda _self, _dice, size, _n: torch.ones(size, dtype=torch.int64))
    recipe = Recipe(**PLAIN, own_background_frac=own, deformed_frac=deformed, any_rotation_frac=1.0)
    batch = GpuComposer(red, "cpu", 2, recipe).batch(8, middle=True)
    found = np.stack([red_box(p) for p in batch["search"]])
    # half a pixel of threshold, one of outlines drawn on whole pixels, each enlarged by about two
    assert np.abs(found - batch["box"].numpy()).max() < 2.5
    assert np.abs(found - batch["box"].numpy()).mean() < 1.0
    previous, middle = (np.stack([red_box(p) for p in batch[k]]) for k in ("previous", "middle"))
    centre = [(b[:, :2] + b[:, 2:]) / 2 for b in (previous, middle, found)]
    assert np.abs(centre[0] - centre[2]).max() > 5
    assert np.abs((centre[0] + centre[2]) / 2 - centre[1]).max() < 2.5


def test_deforming_changes_the_shape(red: Imagery) -> None:
    plain, bent = (
        GpuComposer(red, "cpu", 3, Recipe(**PLAIN, own_background_frac=0, deformed_frac=d)) for d in (0.0, 1.0)
    )
    assert plain.plan(8, (0.0, 1.0)).bend is None
    plan = bent.plan(64, (0.0, 1.0))
    rigid = plan.target[-1].boxes(bent.things.hull[plan.thing])
    assert 0.5 < (plan.box - rigid).abs().mean() < 6


def test_boxes_and_shares_have_the_cpu_composers_statistics(drawn: Imagery, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = Recipe(negative_frac=0.2, deformed_frac=0.0)
    monkeypatch.setattr(Composer, "_look", lambda _self, patches: patches)
    composer = Composer(drawn, 7, recipe)
    samples = [composer.sample() for _ in range(300)]
    plan = GpuComposer(drawn, "cpu", 7, recipe).plan(8000, (0.0, 1.0))
    here, there = plan.box.numpy(), np.array([s.box for s in samples])
    assert plan.positive.float().mean() == pytest.approx(0.8, abs=0.02)
    assert np.mean([s.positive for s in samples]) == pytest.approx(0.8, abs=0.08)
    for box in (here, there):
        box[:, 2:] -= box[:, :2]
        box[:, :2] += box[:, 2:] / 2 - (SEARCH_PX - 1) / 2
    assert here[:, 2:].mean(0) == pytest.approx(there[:, 2:].mean(0), rel=0.08)
    assert here[:, 2:].std(0) == pytest.approx(there[:, 2:].std(0), rel=0.25)
    assert here[:, :2].mean(0) == pytest.approx(0, abs=2)
    assert here[:, :2].std(0) == pytest.approx(there[:, :2].std(0), rel=0.15)


def test_labels_are_those_of_make_labels() -> None:
    rng = np.random.default_rng(4)
    centre, size = rng.uniform(0, SEARCH_PX, (100, 2)), np.exp(rng.uniform(1, 5.3, (100, 2)))
    boxes = np.concatenate([centre - size / 2, centre + size / 2], 1).astype(np.float32)
    boxes[0] = (63, 63, 63, 63)
    made = batch_labels(torch.from_numpy(boxes), torch.ones(100, dtype=torch.bool), Dice(CPU, 1))
    found = {k: v.numpy() for k, v in made.items()}
    for i, box in enumerate(boxes):
        want = make_labels(box, rng)
        assert found["label_loc"][i] == pytest.approx(want.loc, abs=1e-6)
        assert found["label_cls2"][i] == pytest.approx(want.cls2, abs=1e-6)
        cls1, weight = found["label_cls1"][i], found["label_loc_weight"][i]
        for fixed in (1, -2):
            assert ((cls1 == fixed) == (want.cls1 == fixed)).all()
        assert (cls1 == 0).sum() == (want.cls1 == 0).sum()
        assert (weight == 1.5).sum() == (want.loc_weight == 1.5).sum()
        same = (weight != 1.5) & (want.loc_weight != 1.5)
        assert weight[same] == pytest.approx(want.loc_weight[same], abs=1e-6)


def test_negatives_are_background_everywhere() -> None:
    labels = batch_labels(torch.tensor([[100.0, 100, 180, 180]] * 2), torch.tensor([True, False]), Dice(CPU, 1))
    for name in ("label_cls1", "label_cls2", "label_loc_weight"):
        assert labels[name][0].max() >= 1
        assert (labels[name][1] == 0).all()


@pytest.mark.parametrize("scale", [0.25, 0.5, 1.7])
def test_a_ground_is_what_opencv_warps(scale: float) -> None:
    rng = np.random.default_rng(1)
    picture = cv2.resize(rng.integers(0, 255, (30, 40, 3), np.uint8), (512, 400), interpolation=cv2.INTER_CUBIC)
    composer = GpuComposer(Imagery([pyramid_of(picture)], [], ["drawn"], [-1]), "cpu", 1)
    pose = Pose(150, 130, scale, scale * 1.1, 0.3, 0.05, True, 260, 180)
    flip, values = torch.tensor([True]), (150, 130, scale, scale * 1.1, 0.3, 0.05)
    poses = Poses(*(torch.tensor([float(v)]) for v in values), flip)
    anchor = torch.tensor([[260.0, 180.0]])
    ground = Ground.of(composer.atlas, 3, torch.zeros(1, dtype=torch.int64), anchor, poses, SEARCH_PX)
    found = ground.seen(poses, SEARCH_PX)[0].permute(1, 2, 0).numpy() * 255
    want = warp_around(pyramid_of(picture), pose, SEARCH_PX)
    assert np.abs(found - want)[10:-10, 10:-10].mean() < 1.0
    assert want.std() > 30


def test_light_lens_and_codec_do_as_opencv_does() -> None:
    rng = np.random.default_rng(2)
    picture = cv2.resize(rng.integers(0, 255, (60, 60, 3), np.uint8), (287, 287), interpolation=cv2.INTER_CUBIC)
    patch = torch.from_numpy(picture).permute(2, 0, 1)[None].float() / 255

    def error(ours: torch.Tensor, theirs: np.ndarray) -> float:
        return float(np.abs(ours[0].permute(1, 2, 0).numpy() * 255 - theirs).mean())

    assert error(gpu_photometric.grey(patch), photometric.grey(picture)) < 0.6
    assert error(gpu_photometric.haze(patch, torch.tensor([0.3])), photometric.haze(picture, 0.3)) < 0.6
    step = 0.2 + 0.8 * 20 / 63  # factors are taken in 64 steps
    coarse = photometric.coarsen(picture, step)
    assert error(gpu_photometric.coarsen(patch, torch.tensor([step])), coarse) < 0.6
    coded = photometric.compress(picture, 30)
    assert error(gpu_photometric.compress(patch, torch.tensor([30.0])), coded) < 0.5 * error(patch, coded)
    smeared = photometric.motion_blur(picture, 9, 0.4)
    assert error(gpu_photometric.motion_blur(patch, torch.tensor([9.0]), torch.tensor([0.4])), smeared) < 0.35 * error(
        patch, smeared
    )


def test_hulls_keep_their_corners() -> None:
    corners = np.array([[0, 0], [10, 0], [10, 4], [3, 9]], np.float32)
    points = hull_points(np.concatenate([corners, [[5, 2]]]))
    assert points.shape == (64, 2)
    assert all((points == c).all(1).any() for c in corners)
    angle = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    round_points = hull_points(50 * np.stack([np.cos(angle), np.sin(angle)], 1))
    assert np.linalg.norm(round_points, axis=1) == pytest.approx(50, abs=0.01)
    assert round_points.max(0) == pytest.approx([50, 50], abs=0.05)


def test_shares_of_a_batch_have_their_mean() -> None:
    dice = Dice(CPU, 1)
    drawn = [dice.some(0.3, 4) for _ in range(2000)]
    assert np.mean([len(d) for d in drawn]) == pytest.approx(1.2, abs=0.04)
    assert all(len(set(d.tolist())) == len(d) for d in drawn)


def test_pictures_beyond_the_limit_are_refused(drawn: Imagery) -> None:
    with pytest.raises(TooLargeError, match="GB may be taken"):
        GpuComposer(drawn, "cpu", 1, limit_bytes=100_000)


def test_composes_from_pictures_without_objects(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 255, (90, 120, 3), np.uint8)
    batch = GpuComposer(Imagery([pyramid_of(picture)], [], ["drawn"], [-1]), "cpu", 1).batch(2)
    assert batch["search"].float().std() > 5
