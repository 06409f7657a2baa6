"""People as capsules with a gait, and trees as pictures. Local frame as in `models`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.models import darker
from sitl_mocks.world import Colour, ObjectState, Vec3

Image = npt.NDArray[np.uint8]

_SKIN, _HAIR, _TROUSERS, _SHOES = (120, 150, 196), (28, 34, 46), (92, 66, 48), (40, 40, 44)


@dataclass(frozen=True, slots=True)
class Capsule:
    """A limb: two ends (local metres) with their radii."""

    a_m: Vec3
    b_m: Vec3
    a_radius_m: float
    b_radius_m: float
    colour_bgr: Colour


def person(item: ObjectState) -> list[Capsule]:
    """A walker's limbs at its gait: one stride (two steps) per 1.4 m travelled; it stands still at speed zero."""
    height = item.size_m[2]
    speed = math.hypot(item.velocity_ned_mps[0], item.velocity_ned_mps[1])
    swing = min(speed / 1.4, 1.2) * math.sin(item.travelled_m / 1.4 * 2 * math.pi)
    k = height / 1.75
    lean = 0.04 * min(speed, 3.0)
    hip_z, shoulder_z = 0.92 * k, 1.42 * k
    limbs: list[Capsule] = []
    for side in (-1.0, 1.0):
        step = side * swing
        hip = (0.0, side * 0.10 * k, hip_z)
        knee = (0.20 * k * step + 0.05 * k, side * 0.10 * k, 0.50 * k)
        foot = (0.36 * k * step - 0.06 * k * max(-step, 0.0), side * 0.10 * k, 0.07 * k + 0.08 * k * max(-step, 0))
        toe = (foot[0] + 0.16 * k, foot[1], max(foot[2] - 0.02, 0.04))
        limbs += [Capsule(hip, knee, 0.10 * k, 0.08 * k, _TROUSERS), Capsule(knee, foot, 0.08 * k, 0.06 * k, _TROUSERS)]
        limbs.append(Capsule(foot, toe, 0.055 * k, 0.045 * k, _SHOES))
        shoulder = (lean, side * 0.21 * k, shoulder_z)
        elbow = (lean - 0.16 * k * step, side * 0.25 * k, 1.14 * k)
        hand = (lean - 0.26 * k * step + 0.08 * k, side * 0.23 * k, 0.90 * k)
        sleeve = darker(item.colour_bgr, 0.9)
        limbs += [
            Capsule(shoulder, elbow, 0.07 * k, 0.055 * k, sleeve),
            Capsule(elbow, hand, 0.05 * k, 0.045 * k, _SKIN),
        ]
    torso = Capsule((0.0, 0.0, hip_z + 0.02), (lean, 0.0, shoulder_z - 0.05), 0.16 * k, 0.21 * k, item.colour_bgr)
    limbs.append(torso)
    limbs.append(Capsule((lean, 0.0, 1.55 * k), (lean, 0.0, 1.57 * k), 0.065 * k, 0.065 * k, _SKIN))
    head_x = lean + 0.02
    limbs.append(Capsule((head_x, 0.0, 1.62 * k), (head_x, 0.0, 1.64 * k), 0.10 * k, 0.10 * k, _SKIN))
    limbs.append(Capsule((lean - 0.02, 0.0, 1.66 * k), (lean - 0.02, 0.0, 1.67 * k), 0.105 * k, 0.10 * k, _HAIR))
    return limbs


def tree_texture(seed: int) -> Image:
    """A crown and trunk as BGRA (256, 256, 4), base of the trunk at the middle of the lower edge."""
    rng = np.random.default_rng(seed)
    picture = np.zeros((256, 256, 4), np.uint8)
    cv2.rectangle(picture, (122, 170), (134, 255), (38, 52, 66, 255), -1)
    tint = rng.uniform(0.85, 1.2)
    for layer in range(260):
        frac = layer / 260
        angle, radius = rng.uniform(0, 2 * math.pi), math.sqrt(rng.random()) * 88
        x, y = 128 + radius * math.cos(angle), 100 + radius * math.sin(angle) * 0.92
        lit = 0.5 + 0.55 * frac - 0.0025 * (x - 128) - 0.004 * (y - 100) + rng.normal(0, 0.08)
        colour = np.clip(np.array([34, 84, 62]) * lit * tint, 5, 230)
        size = (int(rng.uniform(6, 17)), int(rng.uniform(5, 12)))
        cv2.ellipse(
            picture, (int(x), int(y)), size, float(rng.uniform(0, 180)), 0, 360,
            (int(colour[0]), int(colour[1]), int(colour[2]), 255), -1,
        )  # fmt: skip
    leaf = rng.normal(0, 16, (256, 256, 1)).astype(np.float32)
    picture[..., :3] = np.clip(picture[..., :3] + cv2.GaussianBlur(leaf, (0, 0), 0.8)[..., None] * 1.4, 0, 255)
    return cv2.GaussianBlur(picture, (3, 3), 0).astype(np.uint8)
