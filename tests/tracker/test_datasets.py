"""Readers of big data sets: tiny folders of the published shape."""

from __future__ import annotations

import logging
import os
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.packs import write_pack
from tests.tracker.published_layouts import WRITERS, boxes, coco, got10k, one, vid, vimeo
from tracker.train.compose import Composer, Recipe
from tracker.train.dataset import collate
from tracker.train.datasets import DatasetError, load_sources
from tracker.train.pack import PACK_REACH, BrokenPictureError, load


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_coco_gives_outlined_objects_of_single_pictures(tmp_path: Path) -> None:
    found = one("coco", coco(tmp_path / "coco"))
    assert len(found) == 3
    assert boxes(found) == [(30.0, 20.0, 40.5, 40.25), (80.25, 20.5, 30.0, 50.0), (10, 10, 20, 40)]
    assert [t.label for t in found.things] == ["dog", "person", "person"]
    assert [t.image for t in found.things] == [0, 0, 1]
    assert [len(t.outline) for t in found.things] == [1, 2, 1]
    np.testing.assert_allclose(found.things[0].outline[0], [[30, 20], [70.5, 20], [70.5, 60.25], [30, 60.25]])
    contour = found.things[2].outline[0]
    assert contour.min(0).tolist() == [10, 10]
    assert contour.max(0).tolist() == [29, 49]
    assert found.outlined() == [0, 1, 2]
    assert (len(found.tracks), len(found.clips)) == (0, 0)
    assert list(found.frames) == [-1, -1, -1]


def test_vid_follows_objects_by_their_number(tmp_path: Path) -> None:
    found = one("vid", vid(tmp_path / "vid"))
    assert (len(found), len(found.things), len(found.clips), len(found.tracks)) == (10, 10, 2, 2)
    assert [found.things[i].box for i in found.tracks[0]] == [(20.0 + k, 30.0, 40.0, 40.0) for k in (0, 1, 3, 4)]
    assert [found.frames[found.things[i].image] for i in found.tracks[1]] == [0, 1, 3, 4]
    assert [list(c) for c in found.clips] == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]
    assert found.reach(1) == 100
    assert found.things[4].box == (0.0, 0.0, 30.0, 20.0)
    assert found.things[0].label == "n02084071"


def test_vid_reads_the_layout_without_folders_between(tmp_path: Path) -> None:
    root = vid(tmp_path / "vid" / "ILSVRC2015", "val", between=False)
    found = one("vid", root.parent, "val")
    assert (len(found), len(found.tracks)) == (10, 2)


def test_got10k_leaves_out_what_is_not_to_be_seen(tmp_path: Path) -> None:
    found = one("got10k", got10k(tmp_path / "got"))
    assert (len(found), len(found.things), len(found.clips), len(found.tracks)) == (12, 8, 2, 2)
    assert [found.things[i].box for i in found.tracks[1]] == [(20.5 + k, 30.0, 40.25, 35.0) for k in (0, 1, 3, 5)]
    assert [found.frames[found.things[i].image] for i in found.tracks[1]] == [0, 1, 3, 5]
    assert {t.label for t in found.things} == {"racing car"}
    assert found.reach(0) == 50
    assert found.outlined() == []


@pytest.mark.parametrize("frames", [3, 7])
def test_vimeo_gives_clips_alone(tmp_path: Path, frames: int) -> None:
    found = one("vimeo", vimeo(tmp_path / "vimeo", frames))
    assert (len(found), len(found.things), len(found.tracks)) == (2 * frames, 0, 0)
    assert [len(c) for c in found.clips] == [frames, frames]
    assert found.pyramids.pieces[1].path(frames).parts[-2:] == ("0002", "im1.png")


@pytest.mark.parametrize("kind", WRITERS)
def test_samples_are_drawn_from_each(tmp_path: Path, kind: str) -> None:
    found = one(kind, WRITERS[kind](tmp_path / kind))
    batch = collate(Composer(found, 1, Recipe(clip_frac=0.5), middle=True), 8)
    assert batch["search"].shape == (8, 287, 287, 3)
    assert batch["search"].float().std() > 10
    assert bool(batch["box"].isfinite().all())


def test_pictures_come_from_the_disc_in_three_sizes(tmp_path: Path) -> None:
    found = one("got10k", got10k(tmp_path / "got"))
    assert not found.in_memory
    full, half, quarter = found.pyramids[7]
    assert (full.shape, half.shape, quarter.shape) == ((120, 160, 3), (60, 80, 3), (30, 40, 3))
    path = tmp_path / "got" / "train" / "GOT-10k_Train_000002" / "00000002.jpg"
    np.testing.assert_array_equal(full, cv2.imread(str(path)))
    assert found.pyramids[7][0] is full  # kept a while
    with pytest.raises(IndexError):
        found.pyramids[12]


def test_mixed_sources_are_one(tmp_path: Path) -> None:
    write_pack(tmp_path / "pack")
    for kind, write in WRITERS.items():
        write(tmp_path / kind)
    sources = ["pack", *({"dataset": kind, "root": kind} for kind in WRITERS)]
    found, pack = load_sources(sources, tmp_path), load([tmp_path / "pack"])
    assert len(found) == 6 + 3 + 10 + 12 + 6
    assert boxes(found)[:6] == boxes(pack)
    assert len(found.things) == 6 + 3 + 10 + 8
    assert [found.reach(k) for k in range(len(found.tracks))] == [PACK_REACH, 100, 100, 50, 50]
    for track in found.tracks:
        assert len({found.things[i].label for i in track}) == 1
    for clip in found.clips:
        assert len({found.parts[i] for i in clip}) == 1
    assert [found.parts[t.image] for t in found.things][6::4] == ["coco", "vid", "vid", "vid", "got10k", "got10k"]
    assert found.outlined() == [1, 3, 5, 6, 7, 8]
    assert [found.label(i) for i in range(len(found.things))] == [t.label for t in found.things]
    names, inverse, counts = found.part_counts()
    assert names[inverse].tolist() == [found.parts[t.image] for t in found.things]
    assert dict(zip(names.tolist(), counts.tolist(), strict=True)) == {"coco": 3, "drawn": 6, "got10k": 8, "vid": 10}
    assert collate(Composer(found, 5), 16)["template"].shape == (16, 127, 127, 3)


def test_packs_alone_stay_in_memory(tmp_path: Path) -> None:
    write_pack(tmp_path / "pack")
    found = load_sources(["pack"], tmp_path)
    assert found.in_memory
    assert type(found.pyramids) is list
    assert boxes(found) == boxes(load([tmp_path / "pack"]))


def test_limit_takes_evenly(tmp_path: Path) -> None:
    found = one("got10k", got10k(tmp_path / "got", clips=4), limit=2)
    assert [found.pyramids.pieces[1].path(k).parent.name[-1] for k in (0, 6)] == ["1", "3"]
    assert len(found) == 12
    assert len(one("coco", coco(tmp_path / "coco"), limit=1).things) == 2


def test_held_out_pictures_are_the_sets_own(tmp_path: Path) -> None:
    root = coco(tmp_path / "coco")
    assert len(one("coco", root, "val")) == 0  # no val2017 on the disc
    coco(root, "val2017")
    held_out = one("coco", root, "val")
    assert held_out.pyramids.pieces[1].path(0).parent.name == "val2017"
    with pytest.raises(DatasetError, match="missing2017: no such folder"):
        one("coco", root, "val", val_subset="missing2017")


def test_index_is_kept_and_built_anew_when_files_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = got10k(tmp_path / "got")
    first = boxes(one("got10k", root))
    assert len(list((tmp_path / "cache").rglob("*.npz"))) == 1
    with monkeypatch.context() as patch:
        patch.setattr("tracker.train.datasets.got10k.clip_of", None)  # must not be asked
        assert boxes(one("got10k", root)) == first
    path = root / "train" / "GOT-10k_Train_000001" / "groundtruth.txt"
    path.write_text(path.read_text().replace("20.5", "21.5"))
    os.utime(path, ns=(1, 1))
    assert boxes(one("got10k", root))[0] == (21.5, 30.0, 40.25, 35.0)


def test_spoilt_cache_is_built_anew(tmp_path: Path) -> None:
    root = vid(tmp_path / "vid")
    first = boxes(one("vid", root))
    (kept,) = (tmp_path / "cache").rglob("*.npz")
    kept.write_bytes(kept.read_bytes()[:200])
    assert boxes(one("vid", root)) == first


def test_broken_picture_is_named_once_and_another_drawn(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    root = coco(tmp_path / "coco")
    spoilt = root / "train2017" / f"{9:012d}.jpg"
    spoilt.write_bytes(spoilt.read_bytes()[:-400])
    found = one("coco", root)
    with caplog.at_level(logging.WARNING):
        collate(Composer(found, 3), 24)
    assert [r.getMessage() for r in caplog.records] == [f"left out of training: {spoilt}: the picture is cut short"]
    for path in (root / "train2017").iterdir():
        path.unlink()
    gone = one("coco", root)
    with pytest.raises(BrokenPictureError, match=r"jpg: No such file"), caplog.at_level(logging.ERROR):
        Composer(gone, 3).sample()


def test_workers_read_for_themselves(tmp_path: Path) -> None:
    found = one("vimeo", vimeo(tmp_path / "vimeo"))
    files = found.pyramids.pieces[1]
    before = files[2][0]
    again = pickle.loads(pickle.dumps(files))
    np.testing.assert_array_equal(again[2][0], before)
    child = os.fork()
    if not child:  # the child's cache is its own: what it reads does not move its parent's
        os._exit(int(not np.array_equal(files[2][0], before) or files[3][0] is None))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert files[2][0] is before
