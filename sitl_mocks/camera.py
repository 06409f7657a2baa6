"""A rendered camera: what a lens on the vehicle sees of the mocked world, and the truth about it.

Frames: OpenCV camera (x right, y down), NED world, FRD body. The same pose, time and seed give the same picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from sitl_mocks.canvas import Silhouette
from sitl_mocks.ground import Ground
from sitl_mocks.ground_view import MIN_HEIGHT_M, paint_ground
from sitl_mocks.lens import Lens, View
from sitl_mocks.object_view import ObjectPainter, visible_frac
from sitl_mocks.world import Vec3, World

Image = npt.NDArray[np.uint8]
BoxXywh = tuple[float, float, float, float]

_NOISE_TILE_PX = 1024


@dataclass(frozen=True, slots=True)
class Sensor:
    """Noise (standard deviation in grey levels), blur (Gaussian, px), exposure (gain), vignetting (corner loss)."""

    noise_std: float = 2.5
    blur_px: float = 0.55
    exposure: float = 1.0
    vignette_frac: float = 0.12


@dataclass(frozen=True, slots=True)
class Truth:
    """One object in one picture. box_px: x, y, w, h of all of it, also where hidden or outside; None = behind us.

    visible_frac: share of its silhouette inside the frame and not covered.
    """

    box_px: BoxXywh | None
    visible_frac: float


@dataclass(frozen=True, slots=True)
class Rendered:
    """A picture (H, W, 3) BGR u8, and the truth of each moving object by name."""

    image_bgr: Image
    truth: dict[str, Truth] = field(default_factory=dict)


class RenderedCamera:
    """Renders a World from a vehicle's pose. Not to be shared between threads."""

    def __init__(self, world: World, lens: Lens | None = None, sensor: Sensor | None = None) -> None:
        self._world = world
        self.lens = lens or Lens()
        self._sensor = sensor or Sensor()
        self._ground = Ground(world)
        self._painter = ObjectPainter(world.seed)
        self._maps = self.lens.undistorting_maps() if self.lens.is_distorted else None
        self._gain = _vignette(self.lens, self._sensor)
        rng = np.random.default_rng(world.seed + 1)
        tile = rng.normal(0, self._sensor.noise_std, (_NOISE_TILE_PX, _NOISE_TILE_PX, 3))
        self._noise = np.clip(np.round(tile), -127, 127).astype(np.int8)

    def view(self, position_ned_m: Vec3, roll_rad: float, pitch_rad: float, yaw_rad: float) -> View:
        """The camera's pose at a vehicle pose; a landed vehicle's camera stays just above the ground."""
        rotation = self.lens.camera_from_ned(roll_rad, pitch_rad, yaw_rad)
        north, east, down = position_ned_m
        return View(rotation, np.array([north, east, min(down, -MIN_HEIGHT_M)]), self.lens.matrix)

    def render(
        self,
        t_s: float,
        position_ned_m: Vec3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
        taken_t_s: float | None = None,
    ) -> Rendered:
        """The picture at scenario time t_s (s) from a pose (NED metres, radians).

        taken_t_s: where that is another time, for the noise: a scenario's clock may stand, a sensor's noise does not.
        """
        view = self.view(position_ned_m, roll_rad, pitch_rad, yaw_rad)
        picture = np.empty((self.lens.height_px, self.lens.width_px, 3), np.uint8)
        paint_ground(picture, view, self._ground)
        painted = self._painter.paint(picture, view, self._world.state(t_s))
        truth = {actor.name: self._truth(actor.name, painted) for actor in self._world.actors}
        return Rendered(self._develop(picture, t_s if taken_t_s is None else taken_t_s), truth)

    def _truth(self, name: str, painted: dict[str, Silhouette]) -> Truth:
        silhouette = painted.get(name)
        if silhouette is None:
            return Truth(None, 0.0)
        points = self.lens.distort(silhouette.outline_px)
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        box = (float(x0), float(y0), float(x1 - x0), float(y1 - y0))
        return Truth(box, visible_frac(name, painted))

    def _develop(self, picture: Image, t_s: float) -> Image:
        """Lens and sensor: distortion, blur, exposure, noise."""
        image: cv2.typing.MatLike = picture
        if self._maps is not None:
            image = cv2.remap(image, *self._maps, cv2.INTER_LINEAR)
        if self._sensor.blur_px > 0:
            image = cv2.GaussianBlur(image, (3, 3), self._sensor.blur_px)
        if self._gain is not None:
            image = cv2.multiply(image, self._gain, scale=1 / 128)
        if self._sensor.noise_std > 0:
            image = cv2.add(image, self._noise_at(t_s), dtype=cv2.CV_8U)
        return np.asarray(image, np.uint8)

    def _noise_at(self, t_s: float) -> npt.NDArray[np.int8]:
        """A part of the noise tile picked by the time, so that a picture depends on nothing but its arguments."""
        rng = np.random.default_rng((self._world.seed, round(t_s * 1e6) & 0xFFFFFFFF))
        x = int(rng.integers(0, max(_NOISE_TILE_PX - self.lens.width_px, 1)))
        y = int(rng.integers(0, max(_NOISE_TILE_PX - self.lens.height_px, 1)))
        part = self._noise[y : y + self.lens.height_px, x : x + self.lens.width_px]
        if part.shape[:2] == (self.lens.height_px, self.lens.width_px):
            return part
        return np.resize(self._noise, (self.lens.height_px, self.lens.width_px, 3))


def _vignette(lens: Lens, sensor: Sensor) -> Image | None:
    """Gain per pixel times 128, or None when it is one everywhere."""
    if sensor.vignette_frac == 0 and math.isclose(sensor.exposure, 1.0):
        return None
    y, x = np.mgrid[0 : lens.height_px, 0 : lens.width_px].astype(np.float32)
    r2 = ((x / lens.width_px - 0.5) ** 2 + (y / lens.height_px - 0.5) ** 2) * 2
    gain = 128 * sensor.exposure * (1 - sensor.vignette_frac * r2)
    return np.repeat(np.clip(gain, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def visible_box(truth: Truth, lens: Lens, least_frac: float = 0.2) -> BoxXywh | None:
    """The box cut at the frame, or None when less than least_frac of the object can be seen."""
    if truth.box_px is None or truth.visible_frac < least_frac:
        return None
    x, y, w, h = truth.box_px
    x0, y0 = max(x, 0.0), max(y, 0.0)
    x1, y1 = min(x + w, float(lens.width_px)), min(y + h, float(lens.height_px))
    return (x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None
