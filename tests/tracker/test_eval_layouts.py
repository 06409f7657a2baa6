"""Every published layout, in tiny folders of exactly that shape."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.eval_sets import sequence_folder, truth, write_boxes, write_pictures
from tracker.eval.attributes import UAV123_ORDER, by_attribute
from tracker.eval.datasets import Dataset, Layout, read_dataset
from tracker.eval.layouts import UAV123_STARTS
from tracker.eval.sequences import Sequence, SequenceError, load_dataset, read_boxes

SHARED_EVAL = Path(__file__).parents[3] / "shared" / "data" / "eval"


def named(dataset: Dataset) -> dict[str, Sequence]:
    assert dataset.broken == ()
    return {s.name: s for s in dataset.sequences}


def numbers(sequence: Sequence) -> list[int]:
    """Of the pictures that are read: their brightness."""
    return [int(image[0, 0, 0]) for image in sequence.images()]


def marks(order: tuple[str, ...], *chosen: str) -> str:
    return ",".join("1" if short in chosen else "0" for short in order)


def test_uav123_finds_the_parts_of_a_recording_and_their_attributes(tmp_path: Path) -> None:
    anno, pictures = tmp_path / "anno" / "UAV123", tmp_path / "data_seq" / "UAV123"
    write_pictures(pictures / "truck4", range(570, 585), 6)
    write_pictures(pictures / "bike1", range(1, 4), 6)
    write_boxes(anno / "bike1.txt", truth(3))
    write_boxes(anno / "truck4_2.txt", np.array([*truth(3), [np.nan] * 4]))
    (anno / "att").mkdir()
    (anno / "att" / "truck4_2.txt").write_text(marks(UAV123_ORDER, "SV", "FOC") + "\n")
    dataset = read_dataset(tmp_path)
    found = named(dataset)
    assert dataset.layout is Layout.UAV123
    assert found["truck4_2"].attributes == ("SV", "FOC")
    assert found["bike1"].attributes is None
    assert found["truck4_2"].fps == 30
    assert numbers(found["truck4_2"]) == [(577 + i) % 256 for i in range(4)]
    assert np.isnan(found["truck4_2"].truth_xywh[3]).all()
    assert by_attribute(dataset.sequences) == {"FOC": ("truck4_2",), "SV": ("truck4_2",)}


@pytest.mark.parametrize("nested", [True, False])
def test_uav123_at_10_fps_keeps_every_third_picture(tmp_path: Path, nested: bool) -> None:
    root = tmp_path / "UAV123_10fps"
    pictures = root / "data_seq" / ("UAV123_10fps" if nested else "")
    write_pictures(pictures / "truck4", range(190, 200), 6)
    write_boxes(root / "anno" / ("UAV123_10fps" if nested else "") / "truck4_2.txt", truth(5))
    dataset = read_dataset(root)
    assert dataset.layout is Layout.UAV123_10FPS
    assert dataset.sequences[0].fps == 10
    assert numbers(dataset.sequences[0]) == [193, 194, 195, 196, 197]  # (577 - 1) / 3 + 1


def test_the_10_fps_edition_is_known_by_its_lengths_too(tmp_path: Path) -> None:
    write_pictures(tmp_path / "data_seq" / "bird1", range(1, 3), 6)
    write_boxes(tmp_path / "anno" / "bird1_1.txt", truth(85))
    assert read_dataset(tmp_path).layout is Layout.UAV123_10FPS
    assert read_dataset(tmp_path, Layout.UAV123).sequences[0].fps == 30


def test_a_part_whose_pictures_are_missing_is_named(tmp_path: Path) -> None:
    write_pictures(tmp_path / "data_seq" / "truck4", range(1, 5), 6)
    write_boxes(tmp_path / "anno" / "truck4_2.txt", truth(2))
    with pytest.raises(SequenceError, match="picture number 577 of truck4_2 is missing"):
        list(read_dataset(tmp_path).sequences[0].images())


@pytest.mark.parametrize("separator", [",", "\t", " "])
def test_uavtrack112_and_its_long_part(tmp_path: Path, separator: str) -> None:
    root = tmp_path / "UAVTrack112"
    write_pictures(root / "data_seq" / "air conditioning box1", range(1, 7), 5)
    write_boxes(root / "anno" / "air conditioning box1.txt", truth(4), separator)
    write_boxes(root / "anno_l" / "air conditioning box1.txt", truth(6), separator)
    (root / "att").mkdir()
    (root / "att" / "air conditioning box1.txt").write_text("0 1 0 0 0 0 0 0 0 0 1 0 0\n")
    dataset = read_dataset(root)
    sequence = named(dataset)["air conditioning box1"]
    assert dataset.layout is Layout.UAVTRACK112
    assert sequence.attributes == ("LR", "LI")
    assert len(list(sequence.images())) == 4
    assert len(named(read_dataset(root, Layout.UAVTRACK112_L))["air conditioning box1"]) == 6


def test_dtb70(tmp_path: Path) -> None:
    root = tmp_path / "DTB70"
    write_pictures(root / "Animal1" / "img", range(1, 4), 5)
    write_boxes(root / "Animal1" / "groundtruth_rect.txt", truth(3))
    dataset = read_dataset(root)
    assert dataset.layout is Layout.DTB70
    assert numbers(dataset.sequences[0]) == [1, 2, 3]


def test_otb_with_its_odd_ones(tmp_path: Path) -> None:
    write_pictures(tmp_path / "David" / "img", range(298, 306))
    write_boxes(tmp_path / "David" / "groundtruth_rect.txt", truth(4))
    write_pictures(tmp_path / "BlurCar1" / "img", range(247, 250))
    (tmp_path / "BlurCar1" / "groundtruth_rect.txt").parent.mkdir(exist_ok=True)
    (tmp_path / "BlurCar1" / "groundtruth_rect.txt").write_text("5\t8\t12\t12\n7 8 12 12\n9\t8\t12\t12\n")
    write_pictures(tmp_path / "Board" / "img", range(1, 4), 5)
    write_boxes(tmp_path / "Board" / "groundtruth_rect.txt", truth(3))
    write_pictures(tmp_path / "Jogging" / "img", range(1, 4))
    for target in (1, 2):
        write_boxes(tmp_path / "Jogging" / f"groundtruth_rect.{target}.txt", truth(3, target), "\t")
    write_pictures(tmp_path / "Human4" / "img", range(1, 4))
    (tmp_path / "Human4" / "groundtruth_rect.1.txt").write_text("")
    write_boxes(tmp_path / "Human4" / "groundtruth_rect.2.txt", truth(3))
    write_pictures(tmp_path / "Tiger1" / "img", range(1, 9))
    write_boxes(tmp_path / "Tiger1" / "groundtruth_rect.txt", truth(8))
    write_pictures(tmp_path / "Football1" / "img", range(1, 9))
    write_boxes(tmp_path / "Football1" / "groundtruth_rect.txt", truth(5))
    dataset = read_dataset(tmp_path)
    found = named(dataset)
    assert dataset.layout is Layout.OTB
    assert set(found) == {"David", "BlurCar1", "Board", "Jogging-1", "Jogging-2", "Human4-2", "Tiger1", "Football1"}
    assert numbers(found["David"]) == [(300 + i) % 256 for i in range(4)]
    assert numbers(found["BlurCar1"]) == [247, 248, 249]
    assert numbers(found["Board"]) == [1, 2, 3]
    assert found["Jogging-2"].truth_xywh[1, 0] == 7
    assert found["Jogging-1"].truth_xywh[1, 0] == 6
    assert numbers(found["Tiger1"]) == [6, 7, 8]
    assert found["Tiger1"].truth_xywh[0, 0] == 15
    assert numbers(found["Football1"]) == [1, 2, 3, 4, 5]


def test_got10k_marks_what_is_out_of_sight(tmp_path: Path) -> None:
    folder = tmp_path / "val" / "GOT-10k_Val_000001"
    write_pictures(folder, range(1, 4), 8)
    write_boxes(folder / "groundtruth.txt", truth(3))
    (folder / "cover.label").write_text("8\n0\n3\n")
    (folder / "meta_info.ini").write_text("[METAINFO]\nurl: https://x/?v=%20\nanno_fps: 10Hz\n")
    (tmp_path / "val" / "list.txt").write_text("GOT-10k_Val_000001\n")
    for root in (tmp_path, tmp_path / "val"):
        dataset = read_dataset(root)
        assert dataset.layout is Layout.GOT10K
        assert dataset.sequences[0].fps == 10
        assert np.isnan(dataset.sequences[0].truth_xywh).any(1).tolist() == [False, True, False]
        assert len(list(dataset.sequences[0].images())) == 3


def test_a_plain_folder_of_sequences(tmp_path: Path) -> None:
    sequence_folder(tmp_path, "inside", 3)
    write_pictures(tmp_path / "beside", range(1, 3))
    write_boxes(tmp_path / "beside.txt", truth(2))
    write_video(tmp_path / "clip.avi", 4)
    write_boxes(tmp_path / "clip.txt", truth(4))
    dataset = read_dataset(tmp_path)
    assert dataset.layout is Layout.FOLDER
    assert {s.name: s.fps for s in dataset.sequences} == {"beside": 30, "clip": 10, "inside": 30}
    assert {name: len(list(s.images())) for name, s in named(dataset).items()} == {"beside": 2, "clip": 4, "inside": 3}


def write_video(path: Path, count: int) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 32))
    for number in range(count):
        writer.write(np.full((32, 64, 3), 20 * number, np.uint8))
    writer.release()


def test_one_video_or_one_folder_with_a_file_of_boxes(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.avi", 4)
    write_pictures(tmp_path / "pictures", range(1, 5))
    write_boxes(tmp_path / "elsewhere.csv", truth(4))
    for path in (tmp_path / "clip.avi", tmp_path / "pictures"):
        with pytest.raises(SequenceError, match="--boxes"):
            load_dataset(path)
        dataset = read_dataset(path, boxes=tmp_path / "elsewhere.csv")
        assert dataset.layout is Layout.SINGLE
        assert len(list(dataset.sequences[0].images())) == 4


def test_index_json(tmp_path: Path) -> None:
    write_video(tmp_path / "a.avi", 3)
    write_boxes(tmp_path / "a.txt", truth(3))
    rows = [{"name": "a", "video": "a.avi", "boxes": "a.txt", "fps": 12, "attributes": ["SV"]}]
    (tmp_path / "index.json").write_text(json.dumps(rows))
    (sequence,) = load_dataset(tmp_path)
    assert (sequence.fps, sequence.attributes, len(list(sequence.images()))) == (12, ("SV",), 3)
    (tmp_path / "index.json").write_text('{"name": 1}')
    with pytest.raises(SequenceError, match=r"index\.json: not a list of sequences"):
        load_dataset(tmp_path)


@pytest.mark.parametrize(("boxes", "complaint"), [(3, "more frames than the 3 boxes"), (5, "4 frames against 5 boxes")])
def test_another_number_of_boxes_than_frames_is_refused(tmp_path: Path, boxes: int, complaint: str) -> None:
    write_video(tmp_path / "clip.avi", 4)
    write_boxes(tmp_path / "clip.txt", truth(boxes))
    with pytest.raises(SequenceError, match=complaint):
        list(load_dataset(tmp_path)[0].images())


def test_a_broken_sequence_does_not_hide_the_others(tmp_path: Path) -> None:
    sequence_folder(tmp_path, "good", 3)
    (sequence_folder(tmp_path, "words", 3) / "groundtruth.txt").write_text("1,2,x,4\n")
    write_boxes(sequence_folder(tmp_path, "absent", 2) / "groundtruth.txt", np.array([[np.nan] * 4, [1.0, 2, 3, 4]]))
    dataset = read_dataset(tmp_path)
    assert [s.name for s in dataset.sequences] == ["good"]
    reasons = {each.name: each.reason for each in dataset.broken}
    assert "line 1: not numbers" in reasons["words"]
    assert reasons["absent"] == "absent: no box in the first frame to begin with"
    with pytest.raises(SequenceError, match="absent: no box"):
        load_dataset(tmp_path)


def test_marks_of_another_length_are_refused(tmp_path: Path) -> None:
    write_pictures(tmp_path / "data_seq" / "bike1", range(1, 3), 6)
    write_boxes(tmp_path / "anno" / "bike1.txt", truth(2))
    (tmp_path / "anno" / "att").mkdir()
    (tmp_path / "anno" / "att" / "bike1.txt").write_text("1,0,1")
    (broken,) = read_dataset(tmp_path).broken
    assert "not 12 marks of 0 or 1" in broken.reason


@pytest.mark.parametrize("text", ["1;2;3;4", "1, 2, 3, 4", "1\t2\t3\t4", "1 2 3 4", "1,2,3,4,", "\ufeff1,2,3,4"])
def test_every_usual_separator(tmp_path: Path, text: str) -> None:
    path = tmp_path / "boxes.txt"
    path.write_text(text + "\r\n", encoding="utf-8")
    assert read_boxes(path).tolist() == [[1, 2, 3, 4]]


@pytest.mark.skipif(not SHARED_EVAL.exists(), reason="the frame ranges of UAV123@10fps are not on this machine")
def test_the_table_of_parts_gives_the_published_frame_ranges() -> None:
    ranges = json.loads((SHARED_EVAL / "uav123_10fps" / "frame_ranges.json").read_text())
    starts = {name: (UAV123_STARTS.get(name, 1) - 1) // 3 + 1 for name in ranges}
    assert starts == {name: each["start"] for name, each in ranges.items()}
    assert set(UAV123_STARTS) <= set(ranges)
