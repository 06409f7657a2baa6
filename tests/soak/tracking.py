"""`python -m tests.soak.tracking`: an hour of pictures through the real tracker, as fast as it goes.

Over the shipped sequences again and again, the target lost and found in them, every new pass a new selection, as an
operator would. Fails where memory grows by more than 1 MB an hour of pictures after the first sixth.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator

from tqdm import tqdm

from sitl_mocks import sequences
from tests.soak.samples import Sample, growth, sample, slope_mb_per_h
from tracker.box import Box
from tracker.crop import Image
from tracker.eval.datasets import read_dataset
from tracker.weights import load_tracker

FPS = 30.0
EVERY = 300  # pictures between two samples
SLOPE_MB_PER_H = 1.0


def pictures() -> Iterator[tuple[Image, Box | None]]:
    """Without end; with the box where a selection is due."""
    shipped = read_dataset(sequences.path(sequences.names()[0]).parent).sequences
    films = [(list(each.images()), Box.from_xywh(*(float(v) for v in each.truth_xywh[0]))) for each in shipped]
    while True:
        for images, box in films:
            yield from ((image, box if number == 0 else None) for number, image in enumerate(images))


def main() -> int:
    """0 where nothing grew."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.tracking", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help=f"of pictures, {FPS:g} a second")
    parser.add_argument("--engine", default="torch")
    given = parser.parse_args()
    tracker = load_tracker("compact", engine=given.engine, threads=1)
    count, samples, began_s = round(given.minutes * 60 * FPS), list[Sample](), time.monotonic()
    hidden = 0
    for number, (image, box) in zip(tqdm(range(count), unit=" pictures"), pictures(), strict=False):
        if box is not None:
            tracker.init(image, box)
        else:
            hidden += not tracker.update(image).visible
        if number % EVERY == 0:
            samples.append(sample(number / FPS))
    settled = samples[len(samples) // 6 :]
    slope = slope_mb_per_h(settled)
    counts = growth(settled)
    print(
        f"{given.engine}: {count} pictures in {(time.monotonic() - began_s) / 60:.1f} min, target hidden in {hidden}; "
        f"memory {settled[0].rss_mb:.1f} to {settled[-1].rss_mb:.1f} MB, {slope:+.2f} MB/h; "
        + ", ".join(f"{what} {low}..{high}" for what, (low, high) in counts.items())
    )
    grown = any(high > low for low, high in counts.values())
    return int(slope > SLOPE_MB_PER_H or grown)


if __name__ == "__main__":
    sys.exit(main())
