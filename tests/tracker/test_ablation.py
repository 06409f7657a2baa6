"""The ablations' runner, with budgets that teach nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml

from tests.tracker.conftest import TINY, random_network
from tests.tracker.packs import write_pack
from tracker.configs import ClimNetConfig, Variant
from tracker.eval.ope import Score
from tracker.train import ablation_config
from tracker.train.ablation import AblationRun, ablate
from tracker.train.ablation_config import AblationConfig, EvaluationLatent
from tracker.train.ablation_report import Cell, Spread, honest_note, rows_of
from tracker.train.ablation_training import shared_backbone
from tracker.train.config import TrainConfigError
from tracker.train.priming import initial_network
from tracker.weights import WeightsError, load_network, save

FRAMES = 6


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack, a sequence of a square on the move, and weights whose backbone the variants share."""
    folder = tmp_path_factory.mktemp("ground")
    write_pack(folder / "pack")
    records = json.loads((folder / "pack" / "pack.json").read_text())
    for record in records[:2]:
        record["split"] = "val"
    (folder / "pack" / "pack.json").write_text(json.dumps(records))
    frames = folder / "eval" / "square"
    frames.mkdir(parents=True)
    rng = np.random.default_rng(0)
    background = cv2.GaussianBlur(rng.integers(0, 255, (120, 160, 3), np.uint8), (9, 9), 0)
    boxes = []
    for i in range(FRAMES):
        image = background.copy()
        cv2.rectangle(image, (40 + 4 * i, 50), (64 + 4 * i, 70), (0, 0, 255), -1)
        cv2.imwrite(str(frames / f"{i + 1:04d}.png"), image)
        boxes.append(f"{40 + 4 * i},50,24,20")
    (folder / "eval" / "square.txt").write_text("\n".join(boxes) + "\n")
    entry = {"name": "square", "video": "square", "boxes": "square.txt", "fps": 10}
    (folder / "eval" / "index.json").write_text(json.dumps([entry]))
    save(folder / "tiny.safetensors", random_network(replace(TINY, climnet=None)))
    return folder


def settings(ground: Path, **changes: object) -> dict[str, object]:
    return {
        "start_from": str(ground / "tiny.safetensors"),
        "packs": ["pack"],
        "seeds": [1],
        "samples": 8,
        "batch": 4,
        "warmup_steps": 1,
        "held_out_samples": 4,
        "climnet": {"stem": 6, "stages": [6, 6, 6, 6]},
        "climnet_samples": 4,
        "climnet_batch": 2,
        "climnet_patch_px": 32,
        **changes,
    }


def run(ground: Path, out: Path, **changes: object) -> dict[str, dict[str, object]]:
    table = ablate(settings(ground, **changes), ground, ground / "eval", out, lambda line: None)
    assert table.exists()
    assert (out / "chart.png").stat().st_size > 1000
    return json.loads((out / "table.json").read_text())


def test_variants_are_trained_and_scored_and_gone_on_with(ground: Path, tmp_path: Path) -> None:
    chosen = {"variants": ["hift", "gstc_lct", "full"], "seeds": [1, 2], "intervals": [1, 3], "climnet_samples": 0}
    result = run(ground, tmp_path, **chosen)
    assert [(r["variant"], r["interval"]) for r in result["rows"]] == [
        ("hift", 1), ("gstc_lct", 1), ("full", 1), ("full", 3)
    ]  # fmt: skip
    assert [r["latent"] for r in result["rows"]] == ["none", *["previous patch"] * 3]
    assert all(0 <= r["auc"]["mean"] <= 1 and r["auc"]["count"] == 2 for r in result["rows"])
    text = (tmp_path / "table.md").read_text()
    assert "one and the same" in text  # no ClimNet was run
    assert "not a finding" in text or "exceeds" in text
    kept = {p: p.stat().st_mtime_ns for p in [*tmp_path.glob("graders/*"), *tmp_path.glob("scores/*")]}
    assert len(list(tmp_path.glob("graders/*.safetensors"))) == 4  # gstc_lct is full here
    (tmp_path / "scores" / "hift-m1-seed2.json").unlink()
    again = run(ground, tmp_path, **chosen)
    changed = [p.name for p in kept if p.stat().st_mtime_ns != kept[p]]
    assert changed == ["hift-m1-seed2.json"]
    assert again["rows"] == result["rows"]


def test_the_backbone_is_shared_and_keeps_still(ground: Path, tmp_path: Path) -> None:
    run(ground, tmp_path, variants=["lct", "climnet_hift"], climnet_samples=0)
    _, backbone = shared_backbone(str(ground / "tiny.safetensors"))
    for path in tmp_path.glob("graders/*.safetensors"):
        network = load_network(path)
        for name, value in network.backbone.state_dict().items():
            torch.testing.assert_close(value, backbone[name], rtol=0, atol=0)
        fresh = initial_network(network.config, 1)  # the heads have moved from where they started
        assert not torch.equal(network.grader.cls1.weight, fresh.grader.cls1.weight)


def test_each_variant_is_scored_with_its_own_climnet(ground: Path, tmp_path: Path) -> None:
    result = run(ground, tmp_path, variants=["gstc_lct", "ms_fusion_lct"], latent="climnet", intervals=[1])
    assert [r["latent"] for r in result["rows"]] == ["ClimNet", "ClimNet"]
    assert set(result["latents"]) == {"gstc_lct, seed 1", "ms_fusion_lct, seed 1"}
    config = AblationConfig.from_dict(settings(ground, variants=["gstc_lct", "ms_fusion_lct"], latent="climnet"))
    runner = AblationRun(config, tmp_path, lambda line: None)
    gstc, fusion = (runner.network(entry) for entry in runner.entries())
    assert gstc.grader.variant is fusion.grader.variant is Variant.FULL
    assert torch.equal(gstc.grader.cls1.weight, fusion.grader.cls1.weight)
    assert set(gstc.internet.state_dict()) != set(fusion.internet.state_dict())


def test_climnet_weights_from_elsewhere(ground: Path, tmp_path: Path) -> None:
    trained = random_network(replace(TINY, climnet=ClimNetConfig(3, (4, 4, 6, 6))))
    path = save(tmp_path / "climnet.safetensors", trained)
    changes = {"variants": ["full"], "latent": "climnet", "climnet_samples": 0, "climnet_weights": {"full": str(path)}}
    run(ground, tmp_path / "out", **changes)
    assert str(path) in (tmp_path / "out" / "table.md").read_text()
    runner = AblationRun(AblationConfig.from_dict(settings(ground, **changes)), tmp_path / "out", lambda line: None)
    network = runner.network(runner.entries()[0])
    for ours, reference in zip(network.internet.parameters(), trained.internet.parameters(), strict=True):
        assert torch.equal(ours, reference)


def test_results_of_another_budget_do_not_mix(ground: Path, tmp_path: Path) -> None:
    AblationRun(AblationConfig.from_dict(settings(ground)), tmp_path, lambda line: None)
    with pytest.raises(TrainConfigError, match="another configuration"):
        AblationRun(AblationConfig.from_dict(settings(ground, samples=16)), tmp_path, lambda line: None)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        ({"minutes": 3}, "minutes"),
        ({"variants": ["siamfc"]}, "siamfc"),
        ({"seeds": []}, "one at least"),
        ({"seeds": [1, 1]}, "all different"),
        ({"intervals": [2]}, "1 among them"),
        ({"intervals": [1, 9]}, "in 1..5"),
        ({"interval_variants": ["lct"]}, "latent"),
        ({"latent": "climnet", "climnet_samples": 0}, "full, gstc_lct, ms_fusion_lct"),
        ({"latent": "middle"}, "middle"),
        ({"samples": 1}, "a batch at least"),
        ({"climnet": {"stem": 0, "stages": [1, 1, 1, 1]}}, "climnet.stem"),
        ({"climnet": {"stem": 6, "stages": [4, 6, 6, 6]}}, "6 wide"),
        ({"recipe": {"sugar": 1}}, "sugar"),
    ],
)
def test_unusable_settings_are_refused(ground: Path, change: dict[str, object], wanted: str) -> None:
    with pytest.raises(TrainConfigError, match=wanted):
        AblationConfig.from_dict(settings(ground, **change))


def test_missing_packs_and_weights_are_named(ground: Path, tmp_path: Path) -> None:
    with pytest.raises(TrainConfigError, match=r"nowhere\.tar"):
        run(ground, tmp_path / "a", packs=["nowhere.tar"])
    with pytest.raises(WeightsError, match="nothing"):
        run(ground, tmp_path / "b", start_from="nothing")


def cell(variant: Variant, seed: int, auc: float) -> Cell:
    return Cell(variant, seed, 1, False, Score(auc, auc, auc, auc), {})


def test_spread_over_seeds() -> None:
    spread = Spread.of([0.1, 0.3])
    assert spread.mean == pytest.approx(0.2)
    assert spread.std == pytest.approx(0.2 / np.sqrt(2))  # of a sample, not of the whole
    assert str(Spread.of([0.25])) == "0.250"


@pytest.mark.parametrize(("gap", "says"), [(0.01, "not a finding"), (0.5, "exceeds it")])
def test_the_note_follows_from_the_figures(gap: float, says: str) -> None:
    cells = [cell(Variant.LCT, s, 0.2 + 0.02 * s) for s in (1, 2, 3)]
    cells += [cell(Variant.FULL, s, 0.2 + gap + 0.02 * s) for s in (1, 2, 3)]
    assert says in honest_note(AblationConfig(), rows_of(cells))


def test_one_seed_is_no_finding() -> None:
    config = AblationConfig(seeds=(1,), latent=EvaluationLatent.PREVIOUS)
    assert "nothing can be said" in honest_note(config, rows_of([cell(Variant.LCT, 1, 0.2)]))


def test_the_settings_that_come_along_are_usable() -> None:
    values = yaml.safe_load((Path(ablation_config.__file__).parent / "ablation.yaml").read_text())
    config = AblationConfig.from_dict(values)
    assert set(config.variants) == set(Variant)
    assert AblationConfig.from_dict(config.to_dict()) == config
