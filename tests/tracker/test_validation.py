"""The held-out figures: a network that sees perfectly gets full marks, one that guesses gets chance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from tests.tracker.conftest import TINY
from tests.tracker.packs import write_pack
from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.network.heads import Predictions
from tracker.train import validation
from tracker.train.clips import adjacent_triplets, patch_of, relocalisation_pairs, spread, tracked_clips
from tracker.train.config import StageKind, TrainConfig
from tracker.train.labels import FIRST_PX, GRID, STRIDE_PX
from tracker.train.pack import Imagery, Thing, load
from tracker.train.sheets import SheetError, held_out_sheet, latent_sheet, prediction_sheet, sample_sheet
from tracker.train.validation import Examiner, latent_figures, psnr_db, relocalisation, tracking_figures

CPU = torch.device("cpu")
CHANCE = 0.072  # of offsets up to 64 px, those within 19.4 px


def red_clip(frames: list[int], part: str = "odcam", size: tuple[int, int] = (240, 320)) -> Imagery:
    """A red box that wanders over grey noise, in frames of these numbers; and a still of another part."""
    rng = np.random.default_rng(1)
    imagery = Imagery()
    for i, frame in enumerate([*frames, -1]):
        picture = rng.integers(90, 130, (*size, 1), np.uint8).repeat(3, 2)
        x, y = 100 + 2 * max(frame, 0), 80 + max(frame, 0)
        if frame >= 0:
            cv2.rectangle(picture, (x, y), (x + 29, y + 23), (0, 0, 255), -1)
            imagery.things.append(Thing(i, (x, y, 30, 24)))
        imagery.pyramids.append((picture, picture[::2, ::2], picture[::4, ::4]))
        imagery.parts.append(part if frame >= 0 else "stills")
        imagery.frames.append(frame)
    imagery.clips.append(list(range(len(frames))))
    imagery.tracks.append(list(range(len(frames))))
    return imagery


class RedEye(nn.Module):
    """Puts the box where the patch is red, with full confidence; its features are the patch itself."""

    config = TINY
    internet = None

    def template(self, z: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return z, z

    features = template

    def heads(self, xf: tuple[torch.Tensor, ...], _zf: object, _latent: object) -> Predictions:
        red = (xf[0][:, 2] > 180) & (xf[0][:, 1] < 70)  # (B, S, S)
        cells = FIRST_PX + STRIDE_PX * torch.arange(GRID, dtype=torch.float32)
        loc, cls1 = torch.zeros(len(red), 4, GRID, GRID), torch.zeros(len(red), 2, GRID, GRID)
        for i, mask in enumerate(red):
            ys, xs = torch.nonzero(mask, as_tuple=True)
            corners = [v.float() for v in (xs.min(), ys.min(), xs.max() + 1, ys.max() + 1)]
            x, y = cells[None, :].expand(GRID, GRID), cells[:, None].expand(GRID, GRID)
            gaps = torch.stack([x - corners[0], corners[2] - x, y - corners[1], corners[3] - y])
            loc[i] = torch.tanh(gaps / 143)
            middle = (corners[0] + corners[2]) / 2, (corners[1] + corners[3]) / 2
            cls1[i, 1] = 8 - torch.hypot(x - middle[0], y - middle[1]) / 16
        return Predictions(loc, cls1, torch.zeros(len(red), 1, GRID, GRID))


@pytest.fixture(scope="module")
def burst() -> Imagery:
    return red_clip([0, 1, 2, 9, 10, 11, 18, 19, 20])


def test_perfect_network_finds_everything_again(burst: Imagery) -> None:
    for gap in (5, 20):
        pairs = relocalisation_pairs(burst, gap, seed=1)
        assert pairs
        assert relocalisation(RedEye(), pairs, CPU) == 1.0


def test_network_that_never_looks_gets_chance(burst: Imagery) -> None:
    class Blind(RedEye):
        def heads(self, xf: tuple[torch.Tensor, ...], zf: object, latent: object) -> Predictions:
            there = xf[0].clone()
            there[:] = 0
            there[:, 2, 133:154, 133:154] = 255  # always the middle of the patch
            return super().heads((there,), zf, latent)

    imagery = red_clip(list(range(200)), size=(400, 700))
    pairs = relocalisation_pairs(imagery, 5, seed=1, most=150)
    assert len(pairs) == 150
    assert relocalisation(Blind(), pairs, CPU) == pytest.approx(CHANCE, abs=0.06)


def test_plain_correlation_finds_what_looks_like_the_template(burst: Imagery) -> None:
    class Pixels(RedEye):
        """Layers 4 and 5 at the real sizes, made of the patch's colours alone."""

        def template(self, z: torch.Tensor) -> tuple[torch.Tensor, ...]:
            sizes = ((8, 8), (6, 6)) if z.shape[-1] == 127 else ((28, 28), (26, 26))
            z = z - 110
            whole = nn.functional.interpolate(z, size=sizes[0], mode="area")
            return whole, whole[:, :, 1:-1, 1:-1]

        features = template

    pairs = relocalisation_pairs(burst, 5, seed=3)
    assert relocalisation(Pixels(), pairs, CPU, plain=True) > 0.9


def test_pairs_lie_as_far_apart_as_asked_or_are_left_out(burst: Imagery) -> None:
    assert (
        len(relocalisation_pairs(burst, 20, seed=1)) == 3
    )  # 0, 1 and 2, each with 20; from 9 on nothing lies far enough
    assert relocalisation_pairs(burst, 100, seed=1) == []
    assert relocalisation_pairs(red_clip([0, 2]), 5, seed=1) == []


def test_pairs_are_the_same_for_the_same_seed_only(burst: Imagery) -> None:
    a, b, other = (relocalisation_pairs(burst, 5, seed) for seed in (1, 1, 2))
    assert [p.centre_px for p in a] == [p.centre_px for p in b]
    assert all((p.search == q.search).all() for p, q in zip(a, b, strict=True))
    assert [p.centre_px for p in a] != [p.centre_px for p in other]


def test_patch_has_the_target_in_its_middle_at_the_right_size() -> None:
    frame = np.zeros((400, 400, 3), np.uint8)
    cv2.rectangle(frame, (180, 190), (219, 209), (0, 0, 255), -1)  # 40 x 20 round (200, 200)
    patch = patch_of(frame, Box(200, 200, 40, 20), 287, TrackerConfig())
    ys, xs = np.nonzero(patch[:, :, 2] > 127)
    scale = 127 / np.sqrt((40 + 30) * (20 + 30))
    assert (xs.mean(), ys.mean()) == pytest.approx((143, 143), abs=2)
    assert np.ptp(xs) + 1 == pytest.approx(40 * scale, abs=3)


def test_tracker_of_a_perfect_network_scores_nearly_full(burst: Imagery, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clip's figures come from the tracker's own boxes against the track's."""

    class Perfect:
        def __init__(self, *_: object) -> None:
            self.frame = 0

        def init(self, _image: object, box: Box) -> None:
            self.frame, self.first = 0, box

        def update(self, image: np.ndarray) -> object:
            red = np.argwhere((image[:, :, 2] > 180) & (image[:, :, 1] < 70))
            (y1, x1), (y2, x2) = red.min(0), red.max(0) + 1
            return type("Result", (), {"box": Box.from_xywh(x1, y1, x2 - x1, y2 - y1)})()

    monkeypatch.setattr(validation, "ClimRTTracker", Perfect)
    figures = tracking_figures(RedEye(), tracked_clips(burst))
    assert figures["clip_precision"] == 1.0
    assert figures["clip_auc"] == pytest.approx(20 / 21)  # IoU of 1 is not over 1


def test_the_real_tracker_runs_over_clips(tiny: nn.Module, burst: Imagery) -> None:
    figures = tracking_figures(tiny, tracked_clips(burst))
    assert figures == tracking_figures(tiny, tracked_clips(burst))
    assert 0 <= figures["clip_auc"] <= 1


def test_tracks_too_short_or_too_many_are_left_out() -> None:
    imagery = red_clip(list(range(8)))
    imagery.tracks = [[0, 1, 2], *([list(range(8))] * 5)]
    clips = tracked_clips(imagery, most=3, longest=7)
    assert [len(clip) for clip in clips] == [7, 7, 7]
    assert clips[0].truth_xywh[6] == pytest.approx([112, 86, 30, 24])
    assert spread([1, 2, 3, 4, 5], 3) == [1, 3, 5]


def test_triplets_are_frames_in_a_row_of_videos_only(burst: Imagery) -> None:
    assert len(adjacent_triplets(burst)) == 3  # 0 1 2, 9 10 11, 18 19 20
    assert adjacent_triplets(red_clip([0, 1, 2], part="korban")) == []  # sampled seconds apart


def test_psnr_of_known_errors() -> None:
    black = torch.zeros(1, 3, 8, 8)
    assert psnr_db(black + 255, black) == pytest.approx(0)
    assert psnr_db(black + 25.5, black) == pytest.approx(20, abs=1e-4)
    assert psnr_db(black, black) == 60


def test_latent_frame_is_compared_with_copy_and_mean(tiny: nn.Module, monkeypatch: pytest.MonkeyPatch) -> None:
    levels = [np.full((287, 287, 3), v, np.uint8) for v in (100, 110, 130)]
    monkeypatch.setattr(validation, "latent_patch", lambda _net, previous, current: (previous + current) / 2 - 4)
    figures = latent_figures(tiny, [(levels[0], levels[1], levels[2])], CPU)
    assert figures["psnr_copy_db"] == pytest.approx(20 * np.log10(255 / 10))
    assert figures["psnr_mean_db"] == pytest.approx(20 * np.log10(255 / 5))
    assert figures["psnr_db"] == pytest.approx(20 * np.log10(255 / 1))
    assert figures["psnr_gain_db"] == pytest.approx(20 * np.log10(5))


@pytest.fixture(scope="module")
def held_out(tmp_path_factory: pytest.TempPathFactory) -> Imagery:
    return load([write_pack(tmp_path_factory.mktemp("packs") / "pack", count=10)])


@pytest.fixture(scope="module")
def config() -> TrainConfig:
    return TrainConfig(validation_samples=32)


def test_examination_of_every_stage(tiny: nn.Module, held_out: Imagery, config: TrainConfig) -> None:
    examiner = Examiner(held_out, config)
    tiny.train()
    kinds = {kind: examiner.examine(tiny, kind, CPU) for kind in StageKind}
    assert tiny.training
    tiny.eval()
    assert set(kinds[StageKind.BACKBONE]) >= {"hit_rate"}
    assert set(kinds[StageKind.JOINT]) >= {"hit_rate", "mean_iou"}
    assert set(kinds[StageKind.CLIMNET]) == {"psnr_db", "psnr_copy_db", "psnr_mean_db", "psnr_gain_db"}
    assert all(np.isfinite(list(figures.values())).all() for figures in kinds.values())
    assert kinds[StageKind.JOINT] == Examiner(held_out, config).examine(tiny, StageKind.JOINT, CPU)


def test_score_rises_with_what_the_stage_is_for(held_out: Imagery, config: TrainConfig) -> None:
    score = Examiner(held_out, config).score
    good = {"hit_rate": 0.9, "mean_iou": 0.7, "relocalisation_5": 0.9, "relocalisation_20": 0.8, "clip_auc": 0.6}
    for name in ("mean_iou", "relocalisation_5", "clip_auc"):
        assert score(good | {name: 0.1}, StageKind.JOINT) < score(good, StageKind.JOINT)
    assert score({"hit_rate": 0.5}, StageKind.BACKBONE) == 0.5
    assert score({"psnr_gain_db": -1.0}, StageKind.CLIMNET) == -1.0
    assert score({}, StageKind.JOINT) == -np.inf
    assert score({"mean_iou": float("nan")}, StageKind.JOINT) == -np.inf


def test_sheets_are_pictures_with_the_boxes_on_them(
    tiny: nn.Module, held_out: Imagery, config: TrainConfig, tmp_path: Path
) -> None:
    batch = {k: v[:5].clone() for k, v in Examiner(held_out, config).samples[0].items()}
    batch["positive"][:] = torch.tensor([True, True, True, True, False])
    plain = {k: v for k, v in batch.items() if k in ("template", "previous", "search")}
    sheets = [sample_sheet(batch, tmp_path / "a.png"), sample_sheet(plain, tmp_path / "b.png")]
    sheets += [prediction_sheet(tiny, batch, tmp_path / "c.png"), latent_sheet(tiny, [_grey()] * 2, tmp_path / "d.png")]
    a, b, c, d = (cv2.imread(str(path)) for path in sheets)
    assert a.shape == b.shape
    assert (a != b).any()  # the boxes, and the mark
    assert c.shape == a.shape
    assert d.shape[1] > 5 * 140
    assert sample_sheet({"search": batch["search"]}, tmp_path / "e.png").exists()


def test_every_stage_shows_what_it_learns(
    tiny: nn.Module, held_out: Imagery, config: TrainConfig, tmp_path: Path
) -> None:
    examiner = Examiner(held_out, config)
    examiner.triplets = [_grey()]
    shown = {kind: held_out_sheet(examiner, tiny, kind, tmp_path) for kind in StageKind}
    assert shown[StageKind.BACKBONE] is None
    assert shown[StageKind.JOINT].name == shown[StageKind.HEADS].name == "predictions.png"
    assert shown[StageKind.CLIMNET].name == "latent.png"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["latent.png", "predictions.png"]
    examiner.triplets, examiner.samples = [], []
    assert all(held_out_sheet(examiner, tiny, kind, tmp_path) is None for kind in StageKind)


def _grey() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a, b, c = (np.full((64, 64, 3), v, np.uint8) for v in (10, 20, 30))
    return a, b, c


def test_no_latent_sheet_without_climnet(tmp_path: Path) -> None:
    network = type("Plain", (nn.Module,), {"internet": None, "config": replace(TINY, climnet=None)})()
    with pytest.raises(SheetError, match="has no ClimNet"):
        latent_sheet(network, [_grey()], tmp_path / "latent.png")
