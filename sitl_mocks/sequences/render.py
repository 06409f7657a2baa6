"""Record the shipped sequences again: `python -m sitl_mocks.sequences.render [--out FOLDER] [NAME ...]`."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TextIO

import cv2

from sitl_mocks.camera import BoxXywh, RenderedCamera, Sensor, visible_box
from sitl_mocks.lens import Lens
from sitl_mocks.scenario import load
from sitl_mocks.sequences.follower import Moment, follow

# Noise is what makes a video large.
_SENSOR = Sensor(noise_std=1.0, blur_px=0.8)


@dataclass(frozen=True, slots=True)
class Recording:
    """What to record: a scenario from start_s for length_s (s of scenario time), at fps."""

    scenario: str
    start_s: float
    length_s: float
    fps: float = 12.5
    lens: Lens = Lens(width_px=480, height_px=360)  # noqa: RUF009 - frozen


RECORDINGS = {
    "car": Recording("demo", 25.0, 12.0),
    "walk": Recording("walk", 24.0, 12.0),
    "zigzag": Recording("zigzag", 10.0, 9.0),
}


class RecordingError(ValueError):
    """The video could not be written."""


def record(name: str, recording: Recording, folder: Path) -> int:
    """Write NAME.mp4, .txt, .jsonl and .json into the folder; the number of frames. Raises RecordingError."""
    scenario, lens = load(recording.scenario), recording.lens
    camera = RenderedCamera(scenario.world, lens, _SENSOR)
    video = cv2.VideoWriter(
        str(folder / f"{name}.mp4"),
        cv2.VideoWriter.fourcc(*"mp4v"),
        recording.fps,
        (lens.width_px, lens.height_px),
    )
    if not video.isOpened():
        raise RecordingError(f"cannot write {folder / name}.mp4")
    until_s, count, first_t_s = recording.start_s + recording.length_s, 0, 0.0
    with (folder / f"{name}.txt").open("w") as boxes, (folder / f"{name}.jsonl").open("w") as telemetry:
        for moment in follow(scenario, recording.fps, until_s):
            if moment.t_s < recording.start_s:
                continue
            first_t_s = moment.t_s if count == 0 else first_t_s
            pose = (moment.position_ned_m, moment.roll_rad, moment.pitch_rad, moment.yaw_rad)
            rendered = camera.render(moment.t_s, *pose)
            video.write(rendered.image_bgr)
            box = visible_box(rendered.truth[scenario.world.target_name], lens)
            boxes.write(_line(box))
            _write_moment(telemetry, moment, first_t_s)
            count += 1
    video.release()
    about = {"scenario": recording.scenario, "fps": recording.fps, "frames": count, "lens": asdict(lens)}
    (folder / f"{name}.json").write_text(json.dumps(about, indent=1) + "\n")
    return count


def _line(box: BoxXywh | None) -> str:
    numbers = box or (math.nan,) * 4
    return ",".join("NaN" if math.isnan(x) else f"{x:.1f}" for x in numbers) + "\n"


def _write_moment(out: TextIO, moment: Moment, first_t_s: float) -> None:
    row = asdict(moment) | {"t_s": moment.t_s - first_t_s}
    rounded = {k: [round(x, 4) for x in v] if isinstance(v, tuple) else round(v, 5) for k, v in row.items()}
    out.write(json.dumps(rounded) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m sitl_mocks.sequences.render", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(RECORDINGS)} (default: all)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "data", help="folder to write to")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - set(RECORDINGS))
    if unknown:
        parser.error(f"no such sequence: {', '.join(unknown)}")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or RECORDINGS:
        count = record(name, RECORDINGS[name], options.out)
        size_kb = (options.out / f"{name}.mp4").stat().st_size // 1000
        sys.stdout.write(f"{name}: {count} frames, {size_kb} kB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
