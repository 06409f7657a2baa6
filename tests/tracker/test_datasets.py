"""Readers of big data sets: tiny folders of the published shape, written here."""

from __future__ import annotations

import json
import logging
import os
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.packs import write_pack
from tracker.train.compose import Composer, Recipe
from tracker.train.dataset import collate
from tracker.train.datasets import DatasetError, credits_of_sets, load_sources
from tracker.train.pack import PACK_REACH, BrokenPictureError, Imagery, load

SIZE = (160, 120)  # w, h px


def picture(path: Path, seed: int = 0) -> None:
    """A picture with texture, as its name's ending says."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    image = cv2.resize(rng.integers(0, 255, (15, 20, 3), np.uint8), SIZE, interpolation=cv2.INTER_CUBIC)
    ending = path.suffix.lower().replace("jpeg", "jpg")
    assert cv2.imencode(ending, image)[1].tofile(path) is None


def coco(root: Path, subset: str = "train2017") -> Path:
    """Three pictures: two outlined objects, one by run lengths, a crowd, one too small, one that fills it all."""
    images = [{"id": 9 + k, "file_name": f"{9 + k:012d}.jpg", "width": 160, "height": 120} for k in range(3)]
    for k, image in enumerate(images):
        picture(root / subset / image["file_name"], k)
    square = [30.0, 20.0, 70.5, 20.0, 70.5, 60.25, 30.0, 60.25]
    column = [10 * 120 + 10] + [40, 80] * 19 + [40, 70 + 130 * 120]  # 20 columns from x = 10, 40 rows from y = 10
    runs = {"size": [120, 160], "counts": column}

    def entry(image: int, category: int, bbox: list[float], segmentation: object, iscrowd: int = 0) -> dict:
        return {"id": 1, "image_id": image, "category_id": category, "bbox": bbox, "iscrowd": iscrowd} | {
            "segmentation": segmentation,
            "area": 1.0,
        }

    annotations = [
        entry(9, 18, [30.0, 20.0, 40.5, 40.25], [square]),
        entry(9, 1, [80.25, 20.5, 30.0, 50.0], [[80.25, 20.5, 110.25, 20.5, 95, 70.5], square]),
        entry(10, 1, [10, 10, 20, 40], runs),
        entry(10, 1, [0, 0, 100, 100], {"size": [120, 160], "counts": [0, 160 * 120]}, iscrowd=1),
        entry(11, 18, [5, 5, 9, 40], [square]),
        entry(11, 18, [0, 0, 160, 119], [square]),
    ]
    categories = [{"id": 1, "name": "person"}, {"id": 18, "name": "dog"}]
    (root / "annotations").mkdir(parents=True, exist_ok=True)
    (root / "annotations" / f"instances_{subset}.json").write_text(
        json.dumps({"info": {}, "images": images, "annotations": annotations, "categories": categories})
    )
    return root


def vid_object(track: int, xmin: int, ymin: int, xmax: int, ymax: int, name: str = "n02084071") -> str:
    return (
        f"<object><trackid>{track}</trackid><name>{name}</name><bndbox><xmax>{xmax}</xmax><xmin>{xmin}</xmin>"
        f"<ymax>{ymax}</ymax><ymin>{ymin}</ymin></bndbox><occluded>0</occluded><generated>1</generated></object>"
    )


def vid(root: Path, subset: str = "train", clips: int = 2, between: bool = True) -> Path:
    """Clips of five frames: object 0 absent on the third, object 1 seen on one frame only."""
    for clip in range(clips):
        name = f"ILSVRC2015_{subset}_{clip:08d}"
        inner = Path("VID") / subset / (f"ILSVRC2015_VID_{subset}_0000" if between else "") / name
        (root / "Annotations" / inner).mkdir(parents=True)
        for frame in range(5):
            picture(root / "Data" / inner / f"{frame:06d}.JPEG", frame)
            objects = "" if frame == 2 else vid_object(0, 20 + frame, 30, 59 + frame, 69)
            objects += vid_object(1, 0, 0, 29, 19) if frame == 4 else ""
            (root / "Annotations" / inner / f"{frame:06d}.xml").write_text(
                f"<annotation><folder>{name}</folder><filename>{frame:06d}</filename><source/>"
                f"<size><width>160</width><height>120</height></size>{objects}</annotation>"
            )
    return root


def got10k(root: Path, subset: str = "train", clips: int = 2) -> Path:
    """Sequences of six frames: absent on the third, wholly covered on the fifth."""
    names = [f"GOT-10k_{subset.capitalize()}_{k + 1:06d}" for k in range(clips)]
    for name in names:
        folder = root / subset / name
        for frame in range(6):
            picture(folder / f"{frame + 1:08d}.jpg", frame)
        lines = [f"{20.5 + k:.4f},30.0000,40.2500,35.0000" for k in range(6)]
        (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
        (folder / "absence.label").write_text("0\n0\n1\n0\n0\n0\n")
        (folder / "cover.label").write_text("8\n7\n0\n5\n0\n8\n")
        (folder / "meta_info.ini").write_text("[METAINFO]\nobject_class: racing car\nresolution: (160, 120)\n")
    (root / subset / "list.txt").write_text("\n".join(names) + "\n")
    return root


def vimeo(root: Path, frames: int = 3, subset: str = "train") -> Path:
    """Two sequences, and a blank last line as in the published list."""
    for k in (1, 2):
        for frame in range(1, frames + 1):
            picture(root / "sequences" / "00001" / f"{k:04d}" / f"im{frame}.png", frame)
    kind = {3: "tri", 7: "sep"}[frames]
    (root / f"{kind}_{subset}list.txt").write_text("00001/0001\n00001/0002\n\n")
    return root


WRITERS = {"coco": coco, "vid": vid, "got10k": got10k, "vimeo": vimeo}


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def one(kind: str, root: Path, split: str = "train", **more: object) -> Imagery:
    return load_sources([{"dataset": kind, "root": str(root), **more}], root.parent, split)


def boxes(imagery: Imagery) -> list[tuple[float, ...]]:
    return [t.box for t in imagery.things]


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


def spoil_json(root: Path) -> Path:
    path = root / "annotations" / "instances_train2017.json"
    path.write_text(path.read_text().replace('"bbox": [30.0, 20.0, 40.5, 40.25]', '"bbox": [30.0, 20.0, 40.5]'))
    return path


def spoil_image_id(root: Path) -> Path:
    path = root / "annotations" / "instances_train2017.json"
    path.write_text(path.read_text().replace('"image_id": 10', '"image_id": 77'))
    return path


def spoil_runs(root: Path) -> Path:
    path = root / "annotations" / "instances_train2017.json"
    path.write_text(path.read_text().replace('"counts": [1210', '"counts": [1211'))
    return path


def spoil_xml(root: Path) -> Path:
    path = sorted(root.rglob("000003.xml"))[1]
    path.write_text(path.read_text().replace("<xmax>62</xmax>", "<xmax>wide</xmax>"))
    return path


def spoil_tags(root: Path) -> Path:
    path = sorted(root.rglob("000001.xml"))[0]
    path.write_text(path.read_text()[:-9])
    return path


def spoil_box(root: Path) -> Path:
    path = root / "train" / "GOT-10k_Train_000002" / "groundtruth.txt"
    path.write_text(path.read_text().replace("22.5000,", "", 1))
    return path


def spoil_count(root: Path) -> Path:
    folder = root / "train" / "GOT-10k_Train_000001"
    (folder / "00000006.jpg").unlink()
    return folder / "groundtruth.txt"


def spoil_labels(root: Path) -> Path:
    path = root / "train" / "GOT-10k_Train_000001" / "absence.label"
    path.write_text("0\n1\n")
    return path


def spoil_list(root: Path) -> Path:
    path = root / "tri_trainlist.txt"
    path.write_text("00001/0001\nreadme\n")
    return path


@pytest.mark.parametrize(
    ("kind", "spoil", "what"),
    [
        ("coco", spoil_json, r"length 4.*\$\.annotations\[0\]\.bbox"),
        ("coco", spoil_image_id, "annotation 2 is of image 77"),
        ("coco", spoil_runs, "annotation 2: segmentation: run lengths of 19201 px for a picture of 160 x 120"),
        ("vid", spoil_xml, "could not convert string to float: 'wide'"),
        ("vid", spoil_tags, "unclosed token|not well-formed|no element"),
        ("got10k", spoil_box, r"line 3: '30.0000,40.2500,35.0000' is not x,y,w,h"),
        ("got10k", spoil_count, "6 boxes for 5 pictures"),
        ("got10k", spoil_labels, "2 lines for 6 boxes"),
        ("vimeo", spoil_list, "'readme' is no sequence like 00001/0001"),
    ],
)
def test_a_bad_annotation_is_named(tmp_path: Path, kind: str, spoil, what: str) -> None:
    root = WRITERS[kind](tmp_path / kind)
    path = spoil(root)
    with pytest.raises(DatasetError, match=what) as error:
        one(kind, root)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_missing_root_is_named(tmp_path: Path, kind: str) -> None:
    with pytest.raises(DatasetError, match=rf"^{tmp_path}/nowhere: no such folder"):
        one(kind, tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("source", "what"),
    [
        ("empty", "no picture to train on"),
        ("nopack.tar", r"nopack.tar: no such pack"),
        ({"dataset": "lasot", "root": "x"}, "dataset = 'lasot': known are coco, vid, got10k, vimeo"),
        ({"dataset": "coco"}, "coco has no root"),
        ({"dataset": "coco", "root": "x", "frobnicate": 1}, "unknown key 'frobnicate'"),
        ({"dataset": "coco", "root": "x", "limit": 0}, "limit = 0"),
        ({"dataset": "coco", "root": "x", "subset": 7}, "subset = 7"),
    ],
)
def test_an_unusable_source_is_named(tmp_path: Path, source, what: str) -> None:
    if source == "empty":
        write_pack(tmp_path / "empty", split="val")
    with pytest.raises(DatasetError, match=what):
        load_sources([source], tmp_path)


def test_credits_name_the_sets() -> None:
    credit = credits_of_sets(["shard1.tar", {"dataset": "vid", "root": "a"}, {"dataset": "vid", "root": "b"}])
    assert [c["part"] for c in credit] == ["vid"]
    assert "not commercial" in credit[0]["licence"]
