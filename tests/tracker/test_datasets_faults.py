"""Data sets with a fault in them: each is named in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.tracker.packs import write_pack
from tests.tracker.published_layouts import WRITERS, one
from tracker.train.datasets import DatasetError, credits_of_sets, load_sources


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


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
