"""Objects seen from one camera pose: painted far to near, with the share of the target that stays visible."""

from __future__ import annotations

import math
from collections.abc import Iterable

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.canvas import Canvas, Silhouette
from sitl_mocks.ground import SUN_SHADOW_NE, shadow_outline_m
from sitl_mocks.lens import View
from sitl_mocks.models import ModelLibrary, sun_shade, to_ned
from sitl_mocks.models_living import Capsule, person, tree_texture
from sitl_mocks.world import Kind, ObjectState

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

NEAR_M = 0.4
FAR_M = 400.0
_SHADOW = 0.48
_TREES = 4


class ObjectPainter:
    """Paints objects; keeps the shapes and textures it has built."""

    def __init__(self, seed: int) -> None:
        self._library = ModelLibrary(seed)
        trees = [tree_texture(seed * 31 + i) for i in range(_TREES)]
        self._trees = [_tree_levels(tree) for tree in trees]

    def paint(self, picture: Image, view: View, items: Iterable[ObjectState]) -> dict[str, Silhouette]:
        """Paint all into the picture (H, W, 3), far to near; silhouettes by name, in the order painted."""
        ordered = sorted(items, key=lambda item: _depth_key(item, view))
        for item in ordered:
            if item.kind in (Kind.CAR, Kind.PERSON):
                _paint_shadow(picture, view, item)
        painted: dict[str, Silhouette] = {}
        for item in ordered:
            silhouette = self._paint_one(picture, view, item)
            if silhouette is not None:
                painted[item.name] = silhouette
        return painted

    def _paint_one(self, picture: Image, view: View, item: ObjectState) -> Silhouette | None:
        if item.kind is Kind.PERSON:
            return _paint_person(picture, view, item)
        if item.kind is Kind.TREE:
            return _paint_tree(picture, view, item, self._trees)
        return _paint_faces(picture, view, item, self._library)


def visible_frac(name: str, painted: dict[str, Silhouette]) -> float:
    """Share 0..1 of an object's silhouette that is inside the frame and not covered by a nearer object."""
    target = painted.get(name)
    if target is None or target.area_px <= 0:
        return 0.0
    left = target.mask.copy()
    names = list(painted)
    for other in names[names.index(name) + 1 :]:
        _erase(left, target, painted[other])
    return min(float(left.sum(dtype=np.float64)) / 255 / target.area_px, 1.0)


def _erase(left: Image, target: Silhouette, cover: Silhouette) -> None:
    x0, y0 = max(target.left, cover.left), max(target.top, cover.top)
    x1 = min(target.left + target.mask.shape[1], cover.left + cover.mask.shape[1])
    y1 = min(target.top + target.mask.shape[0], cover.top + cover.mask.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    mine = left[y0 - target.top : y1 - target.top, x0 - target.left : x1 - target.left]
    over = cover.mask[y0 - cover.top : y1 - cover.top, x0 - cover.left : x1 - cover.left]
    cv2.subtract(mine, over, dst=mine)


def _depth_key(item: ObjectState, view: View) -> tuple[int, float]:
    """Far first. A deck above the ground goes last while the camera is above it, first while below."""
    base = item.position_ned_m[2]
    layer = 0 if base > -0.5 else (1 if view.position_ned_m[2] < base else -1)
    middle = np.array(item.position_ned_m) - np.array([0, 0, item.size_m[2] / 2])
    return layer, -float(np.linalg.norm(middle - view.position_ned_m))


def _paint_faces(picture: Image, view: View, item: ObjectState, library: ModelLibrary) -> Silhouette | None:
    shown: list[tuple[float, Array, Array, Image]] = []
    for face in library.faces(item):
        ned = to_ned(face.corners_m, item)
        camera = view.to_camera(ned)
        if camera[:, 2].max() < NEAR_M or camera[:, 2].min() > FAR_M:
            continue
        if float(np.cross(camera[1] - camera[0], camera[3] - camera[0]) @ camera[0]) <= 0:
            continue  # seen from behind
        shown.append((-float(np.linalg.norm(camera.mean(axis=0))), camera, ned, face.texture))
    if not shown:
        return None
    shown.sort(key=lambda entry: entry[0])
    polygons = [view.to_px(_clip_near(camera)) for _, camera, _, _ in shown]
    canvas = Canvas.around(np.concatenate(polygons), picture)
    if canvas is None:
        return None
    for (_, camera, ned, texture), polygon in zip(shown, polygons, strict=True):
        lit = cv2.convertScaleAbs(texture, alpha=sun_shade(ned))
        if camera[:, 2].min() >= NEAR_M:
            canvas.face(polygon, np.asarray(lit, np.uint8))
        else:
            canvas.flat(polygon, np.asarray(lit, np.uint8).reshape(-1, 3).mean(axis=0))
    return canvas.finish(picture, np.concatenate(polygons))


def _clip_near(camera: Array) -> Array:
    """A polygon (N, 3) cut at the near plane."""
    if camera[:, 2].min() >= NEAR_M:
        return camera
    out = []
    for a, b in zip(camera, np.roll(camera, -1, axis=0), strict=True):
        if a[2] >= NEAR_M:
            out.append(a)
        if (a[2] >= NEAR_M) != (b[2] >= NEAR_M):
            out.append(a + (b - a) * (NEAR_M - a[2]) / (b[2] - a[2]))
    return np.array(out)


def _paint_person(picture: Image, view: View, item: ObjectState) -> Silhouette | None:
    f = float(view.matrix[0, 0])
    limbs: list[tuple[float, Capsule, Array, tuple[float, float]]] = []
    for limb in person(item):
        camera = view.to_camera(to_ned(np.array([limb.a_m, limb.b_m]), item))
        if camera[:, 2].min() < NEAR_M:
            return None
        radii = (f * limb.a_radius_m / camera[0, 2], f * limb.b_radius_m / camera[1, 2])
        limbs.append((-float(camera[:, 2].mean()), limb, view.to_px(camera), radii))
    limbs.sort(key=lambda entry: entry[0])
    outline = np.concatenate([_capsule_extent(ends, radii) for _, _, ends, radii in limbs])
    canvas = Canvas.around(outline, picture)
    if canvas is None:
        return None
    for _, limb, ends, radii in limbs:
        canvas.capsule(ends, radii, limb.colour_bgr)
    return canvas.finish(picture, outline)


def _capsule_extent(ends: Array, radii: tuple[float, float]) -> Array:
    r = np.array(radii)[:, None]
    return np.concatenate([ends - r, ends + r])


def _tree_levels(texture: Image) -> list[Image]:
    levels = [texture]
    while levels[-1].shape[0] > 24:
        half = levels[-1].shape[0] // 2
        levels.append(np.asarray(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA), np.uint8))
    return levels


def _paint_tree(picture: Image, view: View, item: ObjectState, trees: list[list[Image]]) -> Silhouette | None:
    """A tree as a flat picture that faces the camera, upright."""
    height, width = item.size_m[2], item.size_m[1]
    foot = np.array(item.position_ned_m)
    ends = view.to_camera(np.stack([foot, foot - np.array([0, 0, height])]))
    if ends[:, 2].min() < 1.0 or ends[:, 2].max() > FAR_M:
        return None
    base, tip = view.to_px(ends)
    # Crowns are round: seen from above they lose little of their height.
    scale = float(view.matrix[0, 0]) / float(ends[:, 2].mean())
    up = tip - base
    up *= max(1.0, 0.62 * scale * height / max(float(np.linalg.norm(up)), 1.0))
    right = np.array([-up[1], up[0]])
    right *= scale * width / max(float(np.linalg.norm(right)), 1e-6)
    corners = np.array([base + up - right / 2, base + up + right / 2, base + right / 2, base - right / 2])
    canvas = Canvas.around(corners, picture, detail=1)
    if canvas is None:
        return None
    levels = trees[round(abs(item.position_ned_m[0] * 7 + item.position_ned_m[1] * 13)) % len(trees)]
    level = int(np.clip(math.log2(max(256 / max(scale * width, 1.0), 1.0)), 0, len(levels) - 1))
    canvas.sprite(corners, levels[level])
    return canvas.finish(picture, corners)


def _paint_shadow(picture: Image, view: View, item: ObjectState) -> None:
    """Darken the ground that a moving object shades."""
    outline = np.array(shadow_outline_m(item))
    if item.kind is Kind.PERSON:
        outline = _narrow(outline, item)
    camera = view.to_camera(np.concatenate([outline, np.zeros((len(outline), 1))], axis=1))
    if camera[:, 2].min() < NEAR_M or camera[:, 2].max() > FAR_M:
        return
    points = view.to_px(camera)
    canvas = Canvas.around(points, picture, detail=2)
    if canvas is None:
        return
    canvas.flat(points, np.zeros(3))
    canvas.darken(picture, _SHADOW)


def _narrow(outline: Array, item: ObjectState) -> Array:
    """A person is thinner than its bounding block: squeeze the shadow across its own direction."""
    along = np.array(SUN_SHADOW_NE) / float(np.linalg.norm(SUN_SHADOW_NE))
    across = np.array([-along[1], along[0]])
    middle = np.array(item.position_ned_m[:2])
    apart = outline - middle
    return np.asarray(middle + np.outer(apart @ along, along) + 0.7 * np.outer(apart @ across, across))
