"""Run by the interpreter of another environment: times OpenCV's contributed trackers there.

Knows nothing of this program: `python contrib_worker.py FILM.npz`, where the film holds `frames` (N, H, W, 3) and
`box` (x, y, w, h). Orders come as JSON lines {"tracker", "threads", "frames", "warm"}; each is answered by one line:
{"cpu_ms": [...], "wall_ms": [...]} or {"error": ...}.
"""

import json
import sys
import time
from typing import Any

import cv2
import numpy as np


def say(**values: Any) -> None:
    sys.stdout.write(json.dumps(values) + "\n")
    sys.stdout.flush()


def main() -> None:
    film = np.load(sys.argv[1])
    frames, box = film["frames"], tuple(int(v) for v in film["box"])
    places: dict[tuple[str, int], int] = {}
    trackers: dict[tuple[str, int], Any] = {}
    say(opencv=cv2.__version__)
    for line in sys.stdin:
        order = json.loads(line)
        cv2.setNumThreads(order["threads"])
        key = order["tracker"], order["threads"]
        try:
            times = []
            for _ in range(order["warm"] + order["frames"]):
                place = (places.get(key, 0) + 1) % len(frames)
                if place <= 1:
                    trackers[key] = getattr(cv2, f"Tracker{order['tracker']}").create()
                    trackers[key].init(frames[0], box)
                    place = 1
                places[key] = place
                cpu_s, wall_s = time.process_time(), time.perf_counter()
                trackers[key].update(frames[place])
                times.append(((time.process_time() - cpu_s) * 1e3, (time.perf_counter() - wall_s) * 1e3))
            times = times[order["warm"] :]
            say(cpu_ms=[cpu for cpu, _ in times], wall_ms=[wall for _, wall in times])
        except (cv2.error, AttributeError, KeyError) as error:
            say(error=str(error).strip().splitlines()[0])


if __name__ == "__main__":
    main()
