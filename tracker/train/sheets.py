"""Pictures of what a run is fed and what it makes of it: samples, latent frames, predictions, as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch

from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.folded import FoldedClimNet
from tracker.train.clips import Triplet, spread
from tracker.train.config import StageKind
from tracker.train.dataset import Batch
from tracker.train.objective import to_input
from tracker.train.validation import Examiner, find, psnr_db

CELL_PX = 144  # side of one picture on a sheet
LINE_PX = 14  # height of a line of text
GAP_PX = 4
PAPER = 255
TRUE_BGR, PREDICTED_BGR, NEGATIVE_BGR, INK_BGR = (80, 220, 80), (60, 60, 255), (40, 40, 230), (30, 30, 30)
ERROR_GAIN = 5.0
SHOWN = 18  # samples of the examination


class SheetError(ValueError):
    """A sheet cannot be drawn or written; one line with the reason."""


def sample_sheet(batch: Batch, path: Path, columns: int = 8) -> Path:
    """Composed samples of tracker.train.dataset: template, previous, (middle,) search with the target's box.

    columns: pictures side by side; a sample takes three of them, or four with a middle frame. A sample whose
    target is not in the search patch is marked, and has no box. ClimNet's batches, without targets, are drawn too.
    """
    names = [name for name in ("template", "previous", "middle", "search") if name in batch]
    cells = []
    for i in range(len(batch["search"])):
        patches = {name: batch[name][i].cpu().numpy().copy() for name in names}
        titles = {name: name for name in names} | {"search": _mark_truth(batch, i, patches["search"])}
        cells.append(_row([_cell(patches[name], titles[name]) for name in names]))
    return _write(path, _grid(cells, max(1, columns // len(names))))


@torch.no_grad()
def latent_sheet(network: ClimRT, triplets: Sequence[Triplet], path: Path) -> Path:
    """As in the paper's figure: previous, latent, true middle and current patch, and the latent frame's error x5.

    PSNR of the latent frame, of the previous frame and of the mean of both is printed under them. Raises
    SheetError for a network without ClimNet, or without triplets.
    """
    if network.internet is None:
        raise SheetError(f"{path}: no sheet of latent frames: the network '{network.config.name}' has no ClimNet")
    device = next(network.parameters()).device
    climnet, rows = FoldedClimNet(network.internet).to(device), []
    for trio in triplets:
        previous, middle, current = (to_input(torch.from_numpy(p)[None], device) for p in trio)
        latent = latent_patch(climnet, previous, current)
        drawn, copied, mean = (psnr_db(guess, middle) for guess in (latent, previous, (previous + current) / 2))
        picture = latent[0].permute(1, 2, 0).cpu().numpy().astype(np.uint8)
        error = np.abs(picture.astype(np.float32) - trio[1]) * ERROR_GAIN
        columns = (
            (trio[0], f"previous {copied:.1f} dB"),
            (picture, f"latent {drawn:.1f} dB"),
            (trio[1], f"true (mean {mean:.1f} dB)"),
            (trio[2], "current"),
            (error.clip(0, 255).astype(np.uint8), f"error x{ERROR_GAIN:g}"),
        )
        rows.append(_row([_cell(patch, title) for patch, title in columns]))
    return _write(path, _grid(rows, 1))


@torch.no_grad()
def prediction_sheet(network: ClimRT, batch: Batch, path: Path, columns: int = 8) -> Path:
    """Template, search patch with the true (green) and predicted (red) box, and the score map laid over it."""
    device = next(network.parameters()).device
    was_training = network.training
    network.eval()
    inputs = {name: to_input(batch[name], device) for name in ("template", "search", "previous")}
    found = find(network, **inputs)
    network.train(was_training)
    cells = []
    for i in range(len(batch["search"])):
        search = batch["search"][i].cpu().numpy().copy()
        scores = found.scores[i].float().cpu().numpy()
        overlay = _overlay(search, scores)
        title = _mark_truth(batch, i, search)
        _draw_box(search, found.corners[i].tolist(), PREDICTED_BGR)
        template = _cell(batch["template"][i].cpu().numpy(), "template")
        cells.append(_row([template, _cell(search, title), _cell(overlay, f"score, best {scores.max():.2f}")]))
    return _write(path, _grid(cells, max(1, columns // 3)))


def held_out_sheet(examiner: Examiner, network: ClimRT, stage_kind: StageKind, folder: Path) -> Path | None:
    """predictions.png, or latent.png in ClimNet's stage, of the pictures examined on; None where there are none."""
    if stage_kind is StageKind.CLIMNET:
        some = spread(examiner.triplets, 6)
        return latent_sheet(network, some, folder / "latent.png") if some and network.internet is not None else None
    if stage_kind is StageKind.BACKBONE or not examiner.samples:
        return None
    batch = {name: values[:SHOWN] for name, values in examiner.samples[0].items()}
    return prediction_sheet(network, batch, folder / "predictions.png", columns=9)


def _overlay(search: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """The search patch dimmed under its score map; cell 0 lies at 63 px, cells are 16 px apart."""
    cells = round(len(scores) ** 0.5)
    inner = cells * 16
    heat = cv2.resize(scores.reshape(cells, cells).clip(0, 1), (inner, inner), interpolation=cv2.INTER_NEAREST)
    coloured = cv2.applyColorMap((heat * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    out = (search * 0.5).astype(np.uint8)
    start = (search.shape[0] - inner) // 2
    region = out[start : start + inner, start : start + inner]
    region[:] = cv2.addWeighted(region, 0.6, coloured, 0.7, 0)
    return out


def _mark_truth(batch: Batch, i: int, search: np.ndarray) -> str:
    """Draw the i-th target's box, or mark the patch where it is not there; returns the title to print under it."""
    if "box" not in batch:  # ClimNet's triplets have no target
        return "search"
    if not bool(batch["positive"][i]):
        _draw_frame(search, NEGATIVE_BGR)
        return "search: NOT THERE"
    _draw_box(search, batch["box"][i].tolist(), TRUE_BGR)
    return "search"


def _draw_box(patch: np.ndarray, box: Sequence[float], colour: tuple[int, int, int]) -> None:
    limit = 4 * max(patch.shape[:2])  # an untrained network's corners may lie anywhere
    x1, y1, x2, y2 = (round(min(max(v, -limit), limit)) if np.isfinite(v) else 0 for v in box)
    cv2.rectangle(patch, (x1, y1), (x2, y2), colour, 2)


def _draw_frame(patch: np.ndarray, colour: tuple[int, int, int]) -> None:
    cv2.rectangle(patch, (0, 0), (patch.shape[1] - 1, patch.shape[0] - 1), colour, 9)


def _cell(patch: np.ndarray, title: str) -> np.ndarray:
    """The patch at a sheet's size (never enlarged: a template stays as small as it is) over its title."""
    size = min(CELL_PX, *patch.shape[:2])
    cell = np.full((CELL_PX + LINE_PX, CELL_PX, 3), PAPER, np.uint8)
    x, y = (CELL_PX - size) // 2, CELL_PX - size
    cell[y : y + size, x : x + size] = cv2.resize(patch, (size, size), interpolation=cv2.INTER_AREA)
    cv2.putText(cell, title, (2, CELL_PX + LINE_PX - 3), cv2.FONT_HERSHEY_SIMPLEX, 0.36, INK_BGR, 1, cv2.LINE_AA)
    return cell


def _row(cells: list[np.ndarray]) -> np.ndarray:
    space = np.full((cells[0].shape[0], GAP_PX, 3), PAPER, np.uint8)
    return np.hstack([part for cell in cells for part in (cell, space)])


def _grid(cells: list[np.ndarray], across: int) -> np.ndarray:
    if not cells:
        raise SheetError("nothing to draw a sheet of")
    margin = np.full((cells[0].shape[0], 4 * GAP_PX, 3), PAPER, np.uint8)
    cells = cells + [np.full_like(cells[0], PAPER)] * (-len(cells) % across)
    rows = [np.hstack([p for c in cells[i : i + across] for p in (c, margin)]) for i in range(0, len(cells), across)]
    line = np.full((GAP_PX, rows[0].shape[1], 3), PAPER, np.uint8)
    return np.vstack([part for row in rows for part in (row, line)])


def _write(path: Path, sheet: np.ndarray) -> Path:
    """PNG, made in memory: the file is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    ok, data = cv2.imencode(".png", sheet)
    if not ok:
        raise SheetError(f"{path}: the sheet cannot be encoded as PNG")
    path.write_bytes(data.tobytes())
    return path
