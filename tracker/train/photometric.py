"""What light, lens, sensor and codec do to a patch. All on uint8 BGR, all a fraction of a millisecond."""

from __future__ import annotations

import cv2
import numpy as np


def tone(patch: np.ndarray, rng: np.random.Generator, strength: float = 1.0) -> np.ndarray:
    """Gain, bias, gamma and colour cast by one look-up table."""
    x = np.arange(256, dtype=np.float32)[:, None] / 255
    gamma = np.exp(rng.normal(0, 0.15 * strength))
    gain = np.exp(rng.normal(0, 0.18 * strength)) * np.exp(rng.normal(0, 0.05 * strength, 3))
    bias = rng.normal(0, 0.05 * strength) + rng.normal(0, 0.015 * strength, 3)
    table = np.clip((x**gamma - 0.5) * gain + 0.5 + bias, 0, 1) * 255
    return cv2.LUT(patch, table.astype(np.uint8).reshape(256, 1, 3))


def grey(patch: np.ndarray) -> np.ndarray:
    """Without colour, still three channels."""
    return cv2.cvtColor(cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)


def motion_blur(patch: np.ndarray, length_px: int, angle_rad: float) -> np.ndarray:
    """A straight smear of the given length."""
    kernel = np.zeros((length_px, length_px), np.float32)
    c = (length_px - 1) / 2
    dx, dy = c * np.cos(angle_rad), c * np.sin(angle_rad)
    a, b = (round(c - dx), round(c - dy)), (round(c + dx), round(c + dy))
    cv2.line(kernel, a, b, 1.0)
    return cv2.filter2D(patch, -1, kernel / kernel.sum())


def coarsen(patch: np.ndarray, factor: float) -> np.ndarray:
    """Down and up again: an object of few native pixels."""
    h, w = patch.shape[:2]
    small = cv2.resize(patch, (max(8, round(w * factor)), max(8, round(h * factor))), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR)


def compress(patch: np.ndarray, quality: int) -> np.ndarray:
    """Block quantisation as a video link shows it."""
    return cv2.imdecode(cv2.imencode(".jpg", patch, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)


def haze(patch: np.ndarray, level: float) -> np.ndarray:
    """Towards a light grey."""
    return cv2.addWeighted(patch, 1 - level, np.full_like(patch, 190), level, 0)


class Noise:
    """Sensor noise from a bank drawn once: a random window of it costs one addition."""

    def __init__(self, rng: np.random.Generator, size_px: int = 640) -> None:
        self._bank = rng.normal(0, 32, (size_px, size_px, 3)).clip(-127, 127).astype(np.int16)

    def add(self, patch: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
        """Gaussian noise of the given standard deviation in grey levels."""
        h, w = patch.shape[:2]
        y, x = rng.integers(0, self._bank.shape[0] - h), rng.integers(0, self._bank.shape[1] - w)
        noise = (self._bank[y : y + h, x : x + w] * (sigma / 32)).astype(np.int16)
        return np.clip(patch.astype(np.int16) + noise, 0, 255).astype(np.uint8)
