"""Searching for a lost target: where to look, what to believe. A drawn world and a stand-in for the network."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from tracker.appearance import Appearance, CueWeights, Describer, Distractors, colours, likeness
from tracker.box import Box
from tracker.candidates import RedetectConfig
from tracker.configs import TrackerConfig
from tracker.crop import Image, crop
from tracker.engines.eager import EagerEngine
from tracker.network.climrt import ClimRT
from tracker.redetect import Redetector
from tracker.search_map import CELL_PX, SearchMap

RED, BLUE = (40, 40, 220), (220, 60, 40)
SIZE = 24
GROUND = np.asarray(
    cv2.GaussianBlur(np.random.default_rng(2).integers(60, 180, (480, 640, 3), dtype=np.uint8), (0, 0), 2), np.uint8
)


class Greenless:
    """Answers like an engine: likes whatever is not grey, red and blue alike.

    Its features are the picture's colours, so that likeness tells red from blue as a trained backbone would.
    """

    def __init__(self) -> None:
        self.looks: list[int] = []

    def cut(self, *where: Any) -> Tensor:
        return torch.from_numpy(crop(*where))[None]

    def embed(self, patch: Tensor) -> tuple[Tensor, Tensor]:
        x = patch.permute(0, 3, 1, 2).float()
        if x.shape[-1] > 200:
            self.looks.append(x.shape[-1])
        cells = 28 if x.shape[-1] > 200 else 8
        pooled = torch.nn.functional.adaptive_avg_pool2d(x, cells) / 255
        return pooled, pooled[..., 1:-1, 1:-1]

    def compare(self, search: tuple[Tensor, Tensor], template: Any, latent5: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        colour = search[0].amax(1) - search[0].amin(1)  # (1, 28, 28)
        inner = torch.nn.functional.interpolate(colour[:, None], (287, 287), mode="bilinear")[..., 55:232, 55:232]
        grid = torch.nn.functional.adaptive_avg_pool2d(inner, 11)  # (1, 1, 11, 11): cells 16 px apart
        target = 12 * grid - 2
        loc = torch.full((1, 4, 11, 11), float(np.tanh(32 / 143)))
        return loc, torch.cat([torch.zeros_like(target), target], 1), target


def draw(*things: tuple[float, float, tuple[int, int, int]]) -> Image:
    image = GROUND.copy()
    for x, y, colour in things:
        cv2.rectangle(image, (round(x - 12), round(y - 12)), (round(x + 11), round(y + 11)), colour, -1)
    return image


def redetector(config: RedetectConfig | None = None, weights: CueWeights | None = None) -> tuple[Redetector, Greenless]:
    network = Greenless()
    start = draw((100, 100, RED))
    box = Box(100, 100, SIZE, SIZE)
    any_engine: Any = network
    tracker = TrackerConfig(cls2_is_logit=False)
    found = Redetector(any_engine, tracker, start, box, network.embed(torch.zeros(1, 127, 127, 3)), config=config,
                       weights=weights)  # fmt: skip
    network.looks.clear()
    return found, network


def search(searcher: Redetector, frames: int, image: Image, **known: Any) -> tuple[int, Box] | None:
    for number in range(1, frames + 1):
        believed = searcher.search(image, **known).believed
        if believed is not None:
            return number, believed.box
    return None


def test_a_target_near_the_expected_place_is_believed_at_the_second_look() -> None:
    searcher, _ = redetector()
    searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
    found = search(searcher, 5, draw((310, 210, RED)), expected_px=(300.0, 200.0))
    assert found is not None
    assert found[0] == 2
    assert abs(found[1].cx_px - 310) < SIZE / 2
    assert abs(found[1].cy_px - 210) < SIZE / 2


def test_a_target_anywhere_is_found_in_bounded_looks() -> None:
    config = RedetectConfig(windows_per_frame=2)
    searcher, network = redetector(config)
    searcher.start(GROUND, Box(80, 80, SIZE, SIZE))
    frames = 0
    image = draw((560, 400, RED))
    believed = None
    while believed is None and frames < 40:
        network.looks.clear()
        believed = searcher.search(image, expected_px=(80.0, 80.0)).believed
        frames += 1
        assert len(network.looks) == config.windows_per_frame
    assert believed is not None
    assert abs(believed.box.cx_px - 560) < SIZE / 2


def test_something_of_another_colour_is_not_believed() -> None:
    searcher, _ = redetector()
    searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
    assert search(searcher, 12, draw((310, 210, BLUE)), expected_px=(300.0, 200.0)) is None
    # The network itself takes it for the target: appearance alone holds it back.
    careless, _ = redetector(weights=CueWeights(layer4=0, layer5=0, colour=0, score=5, bias=-1))
    careless.start(GROUND, Box(300, 200, SIZE, SIZE))
    assert search(careless, 12, draw((310, 210, BLUE)), expected_px=(300.0, 200.0)) is not None


def test_the_target_is_preferred_to_its_neighbour() -> None:
    searcher, _ = redetector()
    searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
    found = search(searcher, 6, draw((285, 200, BLUE), (345, 200, RED)), expected_px=(300.0, 200.0))
    assert found is not None
    assert abs(found[1].cx_px - 345) < SIZE / 2


def test_a_known_distractor_is_not_believed_however_alike() -> None:
    trusting = CueWeights(layer4=0, layer5=0, colour=0, score=5, bias=-1)
    other = draw((310, 210, BLUE))
    for remembers in (False, True):
        searcher, _ = redetector(weights=trusting)
        if remembers:
            for _ in range(4):  # once on each side
                searcher.remember(draw((100, 100, RED), (170, 100, BLUE)), Box(100, 100, SIZE, SIZE))
        searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
        assert (search(searcher, 8, other, expected_px=(300.0, 200.0)) is None) == remembers


def test_one_look_is_not_enough() -> None:
    searcher, _ = redetector()
    searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
    for number in range(8):  # each time somewhere else
        image = draw((280 + 45 * (number % 2), 200, RED))
        assert searcher.search(image, expected_px=(300.0, 200.0)).believed is None


def test_a_candidate_moves_along_with_the_camera() -> None:
    searcher, _ = redetector()
    searcher.start(GROUND, Box(300, 200, SIZE, SIZE))
    pan = np.array([[1.0, 0, 60], [0, 1, 0], [0, 0, 1]])
    assert searcher.search(draw((310, 210, RED)), expected_px=(300.0, 200.0)).believed is None
    believed = searcher.search(draw((370, 210, RED)), pan, expected_px=(360.0, 200.0)).believed
    assert believed is not None
    assert believed.looks == 2


def test_what_somebody_knows_better_is_looked_at_first() -> None:
    searcher, _ = redetector(RedetectConfig(windows_per_frame=1))
    searcher.start(GROUND, Box(80, 80, SIZE, SIZE))
    searcher.expect(560.0, 400.0)
    assert searcher.search(draw((565, 395, RED)), expected_px=(80.0, 80.0)).candidates[0].box.cx_px > 500


def test_search_before_start_is_refused() -> None:
    searcher, _ = redetector()
    with pytest.raises(ValueError, match="search before start"):
        searcher.search(GROUND)


def test_map_looks_round_the_expected_place_first_and_then_everywhere() -> None:
    places = SearchMap((640, 480), 200, 300, 30)
    assert places.mass.sum() == pytest.approx(1)
    x, y = places.best(80)
    assert abs(x - 200) <= CELL_PX
    assert abs(y - 300) <= CELL_PX
    seen = np.zeros((480, 640), bool)
    for _ in range(150):
        x, y = places.best(80)
        seen[max(0, round(y) - 40) : round(y) + 40, max(0, round(x) - 40) : round(x) + 40] = True
        places.looked(x, y, 80)
        places.move(None)
    assert seen.mean() > 0.95


def test_map_moves_with_camera_and_target() -> None:
    places = SearchMap((640, 480), 200, 300, 30)
    places.move(np.array([[1.0, 0, 64], [0, 1, -32], [0, 0, 1]]), (16.0, 0.0))
    x, y = places.best(80)
    assert abs(x - 280) <= CELL_PX
    assert abs(y - 268) <= CELL_PX
    for _ in range(30):  # out of the frame: then it may be anywhere
        places.move(np.array([[1.0, 0, 200], [0, 1, 0], [0, 0, 1]]))
    assert places.mass.sum() == pytest.approx(1, abs=1e-4)
    assert places.mass.max() < 0.05


def test_colours_overlap_for_the_same_and_not_for_another() -> None:
    image = draw((100, 100, RED), (300, 100, RED), (500, 100, BLUE))
    red, same, other = (colours(image, Box(x, 100, SIZE, SIZE)) for x in (100, 300, 500))
    assert red.sum() == pytest.approx(1)
    assert np.sqrt(red * same).sum() == pytest.approx(1)
    assert np.sqrt(red * other).sum() < 0.05


def test_likeness_with_the_real_network(tiny: ClimRT) -> None:
    image = draw((100, 100, RED), (300, 100, RED), (500, 100, BLUE))
    describer = Describer(EagerEngine(tiny), TrackerConfig(), image, Box(100, 100, SIZE, SIZE))
    red, same, other = (describer.describe(image, Box(x, 100, SIZE, SIZE)) for x in (100, 300, 500))
    assert likeness(red, red).mean == pytest.approx(1, abs=1e-4)
    assert likeness(red, same).mean > likeness(red, other).mean + 0.2


def test_evidence_grows_with_each_cue_and_not_without_end() -> None:
    evidence = CueWeights()
    view = likeness(appearance(0), appearance(0))
    weak = evidence.log_odds(0.5, view)
    assert evidence.log_odds(1.0, view) > weak
    assert evidence.log_odds(0.5, replace(view, colour=0.0)) < weak
    assert evidence.log_odds(0.5, replace(view, layer4=0.0)) < weak
    assert evidence.log_odds(100.0, view) == evidence.log_odds(1.5, view)


def test_distractors_keep_each_thing_once() -> None:
    known = Distractors()
    assert known.likeness(appearance(0)) == -1
    for seed in (1, 1, 2):
        known.add(appearance(seed))
    assert len(known) == 2
    assert known.likeness(appearance(1)) == pytest.approx(1, abs=1e-4)
    for seed in range(3, 40):
        known.add(appearance(seed))
    assert len(known) == 12
    assert known.likeness(appearance(1)) < 0.8


def appearance(seed: int) -> Appearance:
    rng = np.random.default_rng(seed)
    layer4, layer5 = (rng.standard_normal((8, n, n)).astype(np.float32) for n in (8, 6))
    histogram = np.zeros(1152, np.float32)
    histogram[seed] = 1
    return Appearance(layer4 / np.linalg.norm(layer4, axis=0), layer5 / np.linalg.norm(layer5, axis=0), histogram)
