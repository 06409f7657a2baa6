"""Parts of the station beside the tracker, one thread, at 720p."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Final

from control.camera import CameraModel, bearing_measurement
from control.config import ControlConfig
from control.estimator import TargetEstimator
from control.follow import FollowState, follow_request
from control.gate import gate
from control.gate_limits import Limits
from control.modes import FollowMode, confirm
from control.types import VehicleMode, VehicleState
from gcs import hud
from gcs.benchmark.coded import h264_cases
from gcs.benchmark.films import BOX, Image, frame
from gcs.benchmark.timing import Case, Repeated
from gcs.operator.config import PageConfig
from gcs.operator.web.pictures import encode
from gcs.video.flow import BackgroundFlow
from gcs.video.frame import Frame, fingerprint
from tracker.box import Box

OVERLAY: Final = hud.Overlay(
    state="FOLLOWING", tone=hud.Tone.GOOD, box=BOX, predicted=BOX, confidence=0.87, distance_m=14.2,
    standoff_error_m=-0.4, latency_s=0.142, watermark="SIM",
    lines=("external  10.0 m high  3.1 m/s", "limited: speed", "glass 80, decode 4, wait 3, tracker 15, control 21 ms"),
)  # fmt: skip
_FRAME_S: Final = 1 / 30


def cases(note: Callable[[str], None], *, quick: bool) -> Iterator[Case]:
    """In the order in which a picture meets them."""
    images = [frame(i) for i in range(4)]
    yield from of_picture(images, BOX)
    yield from h264_cases(images, note)
    yield from of_control()
    if not quick:
        command = [sys.executable, "-m", "gcs.cli", "--help"]
        call = lambda: subprocess.run(command, check=True, capture_output=True)  # noqa: E731
        yield Repeated("`gcs --help`, wall time alone counts", call, samples=1)


def of_picture(images: list[Image], box: Box, label: str = "") -> Iterator[Case]:
    """What is done to each picture that is tracked and shown; label: after each name."""
    flow, page = BackgroundFlow(), PageConfig()
    step = [0]

    def follow_background() -> None:
        step[0] += 1
        flow.update(images[step[0] % len(images)], step[0] * _FRAME_S, box)

    shown = Frame(0, images[0], 0.0, 0.0)
    yield Repeated(f"background flow{label}", follow_background)
    yield Repeated(f"fingerprint{label}", lambda: fingerprint(images[0]))
    yield Repeated(f"HUD{label}", lambda: hud.draw(images[0], OVERLAY))
    yield Repeated(f"HUD, boxes alone{label}", lambda: hud.draw_boxes(images[0].copy(), OVERLAY))
    yield Repeated(f"JPEG for the page{label}", lambda: encode(shown, page.jpeg_quality, page.most_width_px))


def of_control() -> Iterator[Case]:
    """One picture of the estimator, one 20 Hz tick of law and gate."""
    config = ControlConfig()
    camera = CameraModel.from_hfov(1280, 720, math.radians(70), mount_rpy_rad=(0.0, math.radians(-25), 0.0))
    estimator = TargetEstimator(config.estimator)
    now = [0.0]

    def see() -> None:
        now[0] += _FRAME_S
        estimator.update(bearing_measurement(camera, 640, 360, 60, 50, (0.0, 0.0, 0.0), now[0], 1.0))

    see()
    # The law flies by an estimator of its own, whose time stands still.
    seen = TargetEstimator(config.estimator)
    t_s = 0.0
    for number in range(30):
        t_s = number * _FRAME_S
        seen.update(bearing_measurement(camera, 640, 360, 60, 50, (0.0, 0.0, 0.0), t_s, 1.0))
    vehicle = VehicleState(
        heartbeat_t_s=t_s, mode=VehicleMode.EXTERNAL, mode_t_s=t_s, armed=True, in_air=True, attitude_t_s=t_s,
        position_t_s=t_s, height_m=10.0, position_ned_m=(0.0, 0.0, -10.0),
    )  # fmt: skip
    target = seen.predict(t_s)
    assert target is not None
    held = confirm(FollowMode.FOLLOW, target, vehicle, t_s, config.follow)
    limits = Limits()

    request, shape = follow_request(held, target, vehicle, camera, t_s, FollowState.at_rest(t_s), config)

    def law() -> None:
        predicted = seen.predict(t_s + 0.1)
        assert predicted is not None
        follow_request(held, predicted, vehicle, camera, t_s, shape, config)

    yield Repeated("estimator, one picture", see)
    yield Repeated("law, one tick with prediction", law)
    yield Repeated("gate, one tick", lambda: gate(request, vehicle, t_s, None, limits))
