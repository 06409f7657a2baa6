"""The simulator's one process: a mock vehicle on UDP and its rendered camera as MJPEG over HTTP.

Read the video with `cv2.VideoCapture(url, cv2.CAP_FFMPEG)`. Measured at 20 fps on the loopback: the picture is
there 2 to 4 ms after it was published, no frame is held back. OPENCV_FFMPEG_CAPTURE_OPTIONS="fflags;nobuffer"
takes another millisecond off; `flags;low_delay`, `threads;1`, `probesize;32` and `analyzeduration;0` change
nothing. A reader that pauses gets a few old frames first (socket buffers), so read on a thread of its own.

The scenario's clock stands at zero until the vehicle has been steady at its height for a second, and
`move_after_s` more; all targets stand still for the first seconds of every scenario, for a box to be drawn.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np

from sitl_mocks.camera import Rendered, RenderedCamera, Sensor, visible_box
from sitl_mocks.dynamics import Disturbance, Vec3
from sitl_mocks.lens import Lens
from sitl_mocks.mjpeg import MjpegServer
from sitl_mocks.monitor import MonitorLimits, WireMonitor
from sitl_mocks.scenario import Scenario, ScenarioClock
from sitl_mocks.vehicle import MockGimbal, MockVehicle, Personality, Pose
from sitl_mocks.vehicle.server import run_udp


@dataclass(frozen=True, slots=True)
class SimulatorConfig:
    """What the command line sets.

    mavlink: where the station listens. loss_frac: of MAVLink, each way. parameters: the vehicle's, by name,
    in place of the defaults. gimbal: the camera is on one, which begins at the lens's mount pitch.
    confirmations: `operator_confirms` is called for each, so that flying without counts.
    """

    scenario: Scenario
    mavlink: tuple[str, int] = ("127.0.0.1", 14540)
    personality: Personality = Personality.PX4
    video_host: str = "127.0.0.1"
    video_port: int = 0
    fps: float = 20.0
    video_delay_s: float = 0.1
    jpeg_quality: int = 85
    lens: Lens = field(default_factory=Lens)
    sensor: Sensor = field(default_factory=Sensor)
    speed: float = 1.0
    move_after_s: float = 0.0
    start_in_air: bool = False
    seed: int = 0
    wind_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    loss_frac: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    gimbal: bool = False
    confirmations: bool = False
    signing_key: bytes | None = field(default=None, repr=False)
    truth_file: Path | None = None
    summary_file: Path | None = None


@dataclass(frozen=True, slots=True)
class _Shot:
    """What a frame is taken of: the vehicle's true pose and the scenario's time at that moment."""

    pose: Pose
    scenario_t_s: float


class Simulator:
    """`await run(stop, on_ready)`; everything it opened is closed when that returns."""

    def __init__(self, config: SimulatorConfig) -> None:
        self._config = config
        lens = replace(config.lens, mount_pitch_rad=0.0) if config.gimbal else config.lens
        self._vehicle = MockVehicle(
            config.personality,
            yaw_rad=config.scenario.heading_rad,
            airborne_m=config.scenario.height_m if config.start_in_air else None,
            parameters=config.parameters,
            disturbance=Disturbance(wind_ned_mps=config.wind_ned_mps, seed=config.seed),
            signing_key=config.signing_key,
            gimbal=MockGimbal(pitch_rad=config.lens.mount_pitch_rad) if config.gimbal else None,
            seed=config.seed,
        )
        self._vehicle.faults.drop_uplink = self._vehicle.faults.drop_downlink = config.loss_frac
        self._monitor = WireMonitor(MonitorLimits(confirmation_needed=config.confirmations))
        self._clock = ScenarioClock(config.move_after_s, config.speed)
        self._camera = RenderedCamera(config.scenario.world, lens, config.sensor)
        self._server = MjpegServer(config.video_host, config.video_port)
        self._shot: _Shot | None = None  # written by the event loop, read by the camera's thread
        self._frames = self._late_frames = 0

    async def run(self, stop: asyncio.Event, on_ready: Callable[[dict[str, Any]], None]) -> None:
        """Fly and film until `stop`. Raises OSError when a port is taken or a file cannot be written."""
        with contextlib.ExitStack() as files:
            truth = self._config.truth_file
            truth_out = files.enter_context(truth.open("w", encoding="utf-8")) if truth else None
            await self._server.start()
            await self._run_open(stop, on_ready, truth_out)
        if self._config.summary_file is not None:
            self._config.summary_file.write_text(json.dumps(self.summary(), indent=1) + "\n", encoding="utf-8")

    async def _run_open(
        self, stop: asyncio.Event, on_ready: Callable[[dict[str, Any]], None], truth_out: TextIO | None
    ) -> None:
        loop, filming_ends = asyncio.get_running_loop(), threading.Event()
        flight = asyncio.create_task(self._fly(), name="vehicle")
        stopped = asyncio.create_task(stop.wait(), name="stop")
        filming = asyncio.create_task(asyncio.to_thread(self._film, loop, filming_ends, truth_out), name="camera")
        on_ready(self._ready())
        try:
            done, _ = await asyncio.wait({flight, stopped, filming}, return_when=asyncio.FIRST_COMPLETED)
            for task in done - {stopped}:
                task.result()  # the vehicle or the camera never ends by itself: show what broke it
        finally:
            filming_ends.set()
            flight.cancel()
            stopped.cancel()
            await asyncio.gather(flight, stopped, filming, return_exceptions=True)
            await self._server.close()

    def operator_confirms(self) -> None:
        """The operator confirms now; told by who presses the button, not by the station under test."""
        self._monitor.operator_confirms(time.monotonic())

    def summary(self) -> dict[str, Any]:
        """The wire monitor's figures and the camera's."""
        config = self._config
        return {
            "scenario": config.scenario.name,
            "personality": config.personality.value,
            "frames": self._frames,
            "late_frames": self._late_frames,
            "monitor": self._monitor.summary(),
        }

    def _ready(self) -> dict[str, Any]:
        host, port = self._config.mavlink
        lens = self._camera.lens
        return {
            "mavlink": f"udpin://{host}:{port}",
            "video_url": self._server.url,
            "ready": True,
            "scenario": self._config.scenario.name,
            "height_m": self._config.scenario.height_m,
            "camera": {
                "width_px": lens.width_px,
                "height_px": lens.height_px,
                "hfov_rad": lens.hfov_rad,
                "mount_pitch_rad": lens.mount_pitch_rad,
                "distortion": list(lens.distortion),
                "delay_s": self._config.video_delay_s,
                "gimbal": self._config.gimbal,
            },
        }

    # -- the vehicle, on the event loop ---------------------------------------------------------------------

    async def _fly(self) -> None:
        await run_udp(self._vehicle, self._config.mavlink, observe=self._observe, on_step=self._on_step)

    def _observe(self, datagram: bytes, now_s: float) -> None:
        self._monitor.feed(now_s, datagram, self._vehicle.truth())

    def _on_step(self, now_s: float) -> None:
        self._monitor.tick(now_s, self._vehicle.truth())
        pose = self._vehicle.pose()
        height_m, climb_mps = -pose.position_ned_m[2], -pose.velocity_ned_mps[2]
        self._shot = _Shot(pose, self._clock.update(pose.t_s, height_m, climb_mps))

    # -- the camera, on its own thread ------------------------------------------------------------------------

    def _film(self, loop: asyncio.AbstractEventLoop, ends: threading.Event, truth_out: TextIO | None) -> None:
        period_s = 1 / self._config.fps
        due_s, last_t_s = time.monotonic(), -1.0
        while not ends.wait(max(due_s - time.monotonic(), 0.0)):
            now_s = time.monotonic()
            if now_s > due_s + period_s:
                self._late_frames += 1
                due_s = now_s
            due_s += period_s
            shot = self._shot
            if shot is None or shot.pose.t_s <= last_t_s:
                continue
            last_t_s = shot.pose.t_s
            jpeg = self._take(shot, truth_out)
            if not ends.is_set():
                loop.call_soon_threadsafe(self._deliver, loop, jpeg, last_t_s + self._config.video_delay_s)

    def _deliver(self, loop: asyncio.AbstractEventLoop, jpeg: bytes, due_s: float) -> None:
        """Publish at due_s: rendering is part of the delay, not on top of it."""
        loop.call_later(max(due_s - time.monotonic(), 0.0), self._server.publish, jpeg)

    def _take(self, shot: _Shot, truth_out: TextIO | None) -> bytes:
        pose = shot.pose.of_camera
        attitude = (pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
        rendered = self._camera.render(shot.scenario_t_s, pose.position_ned_m, *attitude, taken_t_s=pose.t_s)
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg_quality]
        _, jpeg = cv2.imencode(".jpg", rendered.image_bgr, quality)
        if truth_out is not None:
            truth_out.write(json.dumps(self._row(shot, rendered)) + "\n")
            truth_out.flush()
        self._frames += 1
        return np.asarray(jpeg).tobytes()

    def _row(self, shot: _Shot, rendered: Rendered) -> dict[str, Any]:
        """One line of the truth file: t_s on time.monotonic, box x, y, w, h or null, NED metres and m/s, rad."""
        world, pose = self._config.scenario.world, shot.pose
        target, seen = world.target(shot.scenario_t_s), rendered.truth[world.target_name]
        box, camera = visible_box(seen, self._camera.lens), pose.of_camera
        return {
            "t_s": round(pose.t_s, 6),
            "seq": self._frames,
            "scenario_t_s": round(shot.scenario_t_s, 6),
            "box_px": box and _rounded(box),
            "visible_frac": round(seen.visible_frac, 3),
            "vehicle": {
                "position_ned_m": _rounded(pose.position_ned_m),
                "velocity_ned_mps": _rounded(pose.velocity_ned_mps),
                "roll_pitch_yaw_rad": _rounded((pose.roll_rad, pose.pitch_rad, pose.yaw_rad)),
            },
            "camera": {"roll_pitch_yaw_rad": _rounded((camera.roll_rad, camera.pitch_rad, camera.yaw_rad))},
            "target": {
                "position_ned_m": _rounded(target.position_ned_m),
                "velocity_ned_mps": _rounded([v * self._config.speed for v in target.velocity_ned_mps]),
            },
        }


def _rounded(numbers: Iterable[float]) -> list[float]:
    return [round(number, 4) for number in numbers]
