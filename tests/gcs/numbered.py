"""Pictures that carry their own frame number, as black and white blocks, so that a receiver can say which it got."""

from __future__ import annotations

import numpy as np

from gcs.flight_view import Sighting
from gcs.video.frame import Image
from tests.gcs.fake_station import FakeStation

BITS = 16
SIDE_PX = 32
TOP_PX, LEFT_PX = 64, 16  # beneath the banner of an annotated picture


def numbered(number: int, size: tuple[int, int]) -> Image:
    """A grey picture (H, W, 3) with the number in its blocks; at least 544 px wide."""
    image = np.full((size[1], size[0], 3), 110, np.uint8)
    for bit in range(BITS):
        left = LEFT_PX + bit * SIDE_PX
        image[TOP_PX : TOP_PX + SIDE_PX, left : left + SIDE_PX] = 255 if number >> bit & 1 else 0
    return image


def number_of(image: Image) -> int:
    """The number a picture carries."""
    inner = SIDE_PX // 4
    blocks = image[TOP_PX + inner : TOP_PX + SIDE_PX - inner].mean(axis=(0, 2))
    means = [blocks[LEFT_PX + b * SIDE_PX + inner : LEFT_PX + (b + 1) * SIDE_PX - inner].mean() for b in range(BITS)]
    return sum(1 << bit for bit, mean in enumerate(means) if mean > 128)


class NumberedStation(FakeStation):
    """Each picture carries its frame's number."""

    def show(self) -> Sighting:
        """The next picture, through the watchers."""
        self._seq += 1
        return self._tell(numbered(self._seq, self.size))
