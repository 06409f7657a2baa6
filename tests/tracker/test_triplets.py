"""ClimNet's lesson: three frames cut alike, from videos or composed."""

import numpy as np
import pytest

from tracker.train.compose import Recipe
from tracker.train.dataset import Triplets, triplet_batches, video_clips
from tracker.train.pack import Imagery, Thing, pyramid_of


@pytest.fixture(scope="module")
def imagery() -> Imagery:
    """Two clips of a ramp that brightens by 4 grey levels a frame; the second one is sampled seconds apart."""
    found = Imagery()
    ramp = np.add.outer(np.arange(120), np.arange(160)).astype(np.uint8)[..., None].repeat(3, 2) // 4
    for part, numbers in (("clips", [0, 1, 2, 30, 31, 32]), ("korban", [0, 1, 2])):
        first = len(found.pyramids)
        for number in numbers:
            found.pyramids.append(pyramid_of(ramp + np.uint8(4 * number)))
            found.parts.append(part)
            found.frames.append(number)
            found.things.append(Thing(len(found.pyramids) - 1, (40.0, 30.0, 40.0, 40.0)))
        found.clips.append(list(range(first, len(found.pyramids))))
    return found


def test_only_clips_at_video_rate_have_frames_between(imagery: Imagery) -> None:
    assert video_clips(imagery) == [0]


def test_real_triplets_are_adjacent_and_cut_alike(imagery: Imagery) -> None:
    batch = Triplets(imagery, Recipe(), 1, patch_px=64, real_frac=1.0).batch(24)
    assert set(batch) == {"previous", "search", "middle"}
    previous, middle, search = (batch[k].numpy().astype(int) for k in ("previous", "middle", "search"))
    assert middle.shape == (24, 64, 64, 3)
    steps = np.stack([(middle - previous).mean((1, 2, 3)), (search - middle).mean((1, 2, 3))])
    assert np.allclose(np.abs(steps), 4, atol=0.1)  # 30 - 2 frames apart would be 112
    assert np.allclose(steps[0], steps[1], atol=0.1)
    assert set(np.sign(steps[0])) == {-1, 1}  # some run backwards
    slopes = (middle[:, :, -1].mean((1, 2)) - middle[:, :, 0].mean((1, 2))) > 0
    assert 0 < slopes.sum() < 24  # some are turned over


def test_composed_ones_stand_in_where_there_is_no_video(imagery: Imagery) -> None:
    triplets = Triplets(imagery, Recipe(), 2, patch_px=96, real_frac=0.0)
    assert triplets.batch(2)["search"].shape == (2, 96, 96, 3)
    assert Triplets(imagery, Recipe(), 2, real_frac=0.0).batch(1)["search"].shape == (1, 287, 287, 3)


def test_the_same_seed_draws_the_same(imagery: Imagery) -> None:
    first, second = (next(triplet_batches(imagery, Recipe(), 3, 5, 0, patch_px=64)) for _ in range(2))
    assert all((first[k] == second[k]).all() for k in first)
