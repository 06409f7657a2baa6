"""Composed samples: the box is where the object is, the same seed gives the same sample."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracker.packs import as_tar, write_pack
from tracker.train.compose import SEARCH_PX, TEMPLATE_PX, Composer, Recipe
from tracker.train.pack import load
from tracker.train.warp import Pose, cut_out

# Without anything that would change the red of the drawn object.
PLAIN = Recipe(
    spot_frac=0,
    negative_frac=0,
    distractor_frac=0,
    occluder_frac=0,
    shadow_frac=0,
    coarse_frac=0,
    any_rotation_frac=0,
    clip_frac=0,
)


@pytest.fixture
def pack(tmp_path: Path) -> Path:
    return write_pack(tmp_path / "pack")


def test_tar_and_folder_hold_the_same(pack: Path) -> None:
    a, b = load([pack]), load([as_tar(pack)])
    assert len(a) == len(b) == 6
    assert len(a.things) == 6
    assert all((x[0] == y[0]).all() for x, y in zip(a.pyramids, b.pyramids, strict=True))
    assert a.tracks == [[3, 4, 5]]
    assert len(a.outlined()) == 3


def test_other_split_stays_out(pack: Path) -> None:
    assert len(load([pack], split="val")) == 0


def test_same_seed_same_sample(pack: Path) -> None:
    imagery = load([pack])
    a, b = Composer(imagery, 5).sample(), Composer(imagery, 5).sample()
    assert a.box == b.box
    assert (a.search == b.search).all()


def test_shapes_and_middle_frame(pack: Path) -> None:
    sample = Composer(load([pack]), 1, middle=True).sample()
    assert sample.template.shape == (TEMPLATE_PX, TEMPLATE_PX, 3)
    for patch in (sample.previous, sample.middle, sample.search):
        assert patch is not None
        assert patch.shape == (SEARCH_PX, SEARCH_PX, 3)
        assert patch.dtype == np.uint8


def test_the_box_holds_the_object(pack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Composer, "_look", lambda _self, patches: patches)  # light and noise left out
    composer = Composer(load([pack]), 2, PLAIN)
    checked = 0
    for _ in range(40):
        sample = composer.sample()
        x1, y1, x2, y2 = sample.box
        cx, cy = round((x1 + x2) / 2), round((y1 + y2) / 2)
        if 0 <= cx < SEARCH_PX and 0 <= cy < SEARCH_PX:
            b, g, r = (int(v) for v in sample.search[cy, cx])
            assert r > 200
            assert b < 60
            assert g < 60
            checked += 1
    assert checked > 30


def test_box_of_a_placed_outline_is_exact(pack: Path) -> None:
    imagery = load([pack])
    thing = imagery.things[1]
    pose = Pose(100, 80, 2.0, 2.0, 0.0, 0.0, False)
    assert pose.box_of(cut_out(imagery, thing)) == pytest.approx((50, 44, 150, 116), abs=0.01)
