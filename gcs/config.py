"""The configuration: one YAML file into frozen dataclasses. No file is needed: every key has a default.

Units stand in the names. docs/example.yaml shows every key. Ranges stand beside the fields; those of the
control part, in control/config.py and control/gate_limits.py, can only tighten the gate's own ceilings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

from control.camera import CameraModel
from control.config import ControlConfig
from control.latency import PRIOR_S
from gcs.audit import KNOWN
from gcs.backend import Backend
from gcs.config_yaml import Layered, load_layers
from gcs.errors import ConfigError
from gcs.operator.config import MavlinkCameraConfig, PageConfig, VideoOutConfig
from gcs.profiles import profile_path

Triple = tuple[float, float, float]


def _ranged(low: float, default: float, high: float) -> float:
    return field(default=default, metadata={"low": low, "high": high})


def _optional(low: float, high: float) -> float | None:
    return field(default=None, metadata={"low": low, "high": high})


def _whole(low: int, default: int | None, high: int) -> int:
    return field(default=default, metadata={"low": low, "high": high})  # type: ignore[return-value]


class Latent(Enum):
    """Where the tracker's latent frame comes from; names as in tracker.configs, which stays unimported."""

    CLIMNET = "climnet"
    PREVIOUS = "previous"
    OFF = "off"


class EngineName(Enum):
    """What runs the tracker's network; names as in tracker.engines.catalogue, which stays unimported."""

    TORCH = "torch"
    OPENVINO = "openvino"
    ONNXRUNTIME = "onnxruntime"
    CUDA_FP16 = "cuda-fp16"
    CUDA_BF16 = "cuda-bf16"
    CUDA_TF32 = "cuda-tf32"
    CUDA_FP32 = "cuda-fp32"


class AutopilotChoice(Enum):
    """Which adapter speaks to the vehicle; auto believes its heartbeat."""

    AUTO = "auto"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class FollowChoice(Enum):
    """What a confirmation asks for; names as in control.modes."""

    SPOTLIGHT = "spotlight"
    FOLLOW = "follow"
    PARALLEL = "parallel"
    ORBIT = "orbit"


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """Lens and mount. Either hfov_deg, or fx_px and the rest of a calibration made at width_px by height_px.

    mount_rpy_deg: roll, pitch, yaw of the camera in the vehicle; pitch below zero looks down.
    glass_delay_s: from light on the sensor to the picture's arrival here; null is estimated in flight, from how the
    picture turns as the vehicle does, beginning at 0.1 s.
    """

    hfov_deg: float = _ranged(5.0, 70.0, 170.0)
    width_px: int | None = _whole(16, None, 4096)
    height_px: int | None = _whole(16, None, 4096)
    fx_px: float | None = _optional(10.0, 1e5)
    fy_px: float | None = _optional(10.0, 1e5)
    cx_px: float | None = _optional(-4096.0, 8192.0)
    cy_px: float | None = _optional(-4096.0, 8192.0)
    distortion: tuple[float, float, float, float, float] = field(
        default=(0.0, 0.0, 0.0, 0.0, 0.0), metadata={"low": -10.0, "high": 10.0}
    )
    mount_rpy_deg: Triple = field(default=(0.0, 0.0, 0.0), metadata={"low": -180.0, "high": 180.0})
    glass_delay_s: float | None = _optional(0.0, 2.0)

    def __post_init__(self) -> None:
        if self.fx_px is None and any(v is not None for v in (self.fy_px, self.cx_px, self.cy_px)):
            raise ValueError("fx_px must be given with fy_px, cx_px or cy_px")
        if self.fx_px is not None and (self.width_px is None or self.height_px is None):
            raise ValueError("fx_px needs width_px and height_px, the picture size of the calibration")

    @property
    def assumed_glass_delay_s(self) -> float:
        """What to begin with."""
        return PRIOR_S if self.glass_delay_s is None else self.glass_delay_s

    def model(self, width_px: int, height_px: int) -> CameraModel:
        """The camera for pictures of this size; a calibration is scaled to it.

        Raises ConfigError where the calibration is of another aspect ratio.
        """
        mount = (*(math.radians(a) for a in self.mount_rpy_deg),)
        if self.fx_px is None or self.width_px is None or self.height_px is None:
            return CameraModel.from_hfov(
                width_px,
                height_px,
                math.radians(self.hfov_deg),
                self.distortion,
                mount,  # type: ignore[arg-type]
            )
        scale = width_px / self.width_px
        if abs(self.height_px * scale - height_px) > 1.0:
            raise ConfigError(
                f"camera: calibrated at {self.width_px}x{self.height_px} px, but the video is {width_px}x{height_px} px"
            )
        cx_px = self.width_px / 2 if self.cx_px is None else self.cx_px
        cy_px = self.height_px / 2 if self.cy_px is None else self.cy_px
        focal = (self.fx_px * scale, (self.fy_px or self.fx_px) * scale)
        centre = (cx_px * scale, cy_px * scale)
        return CameraModel(width_px, height_px, *focal, *centre, self.distortion, mount)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class GimbalConfig:
    """The camera is on a gimbal that speaks the Gimbal v2 protocol; its angles replace camera.mount_rpy_deg.

    device_id: which one (154 and up, or 1 to 6 on the autopilot itself), null takes the first that answers.
    """

    enabled: bool = False
    device_id: int | None = _whole(1, None, 255)


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """What tracks, and what runs it. null weights, engine, threads, latent: what is best at `fps` on this machine,
    which is measured once (`gcs bench --auto` measures again).

    weights: a shipped name ("compact") or a .safetensors file. latent_interval: the paper's m, null: the weights'.
    threads: CPU threads of the engine. fps: pictures a second to keep up with. graphs: folder that `gcs weights export`
    has made of these weights, for engine openvino or onnxruntime.
    """

    weights: str | None = None
    latent: Latent | None = None
    latent_interval: int | None = _whole(1, None, 5)
    engine: EngineName | None = None
    threads: int | None = _whole(1, None, 64)
    fps: float = _ranged(1.0, 30.0, 240.0)
    graphs: str | None = None

    def __post_init__(self) -> None:
        if self.graphs is not None and self.engine not in (EngineName.OPENVINO, EngineName.ONNXRUNTIME):
            raise ValueError("graphs needs engine openvino or onnxruntime")


@dataclass(frozen=True, slots=True)
class FollowConfig:
    """What the operator's confirmation asks for; null distances: the one at the moment of confirmation.

    standoff_m: ground distance to hold. distance_m: ground distance at confirmation, where height and view
    angle cannot tell it.
    """

    mode: FollowChoice = FollowChoice.FOLLOW
    standoff_m: float | None = _optional(2.0, 200.0)
    distance_m: float | None = _optional(2.0, 200.0)


@dataclass(frozen=True, slots=True)
class VideoConfig:
    """Where the picture comes from when the command line does not say; fps: rate of an image folder."""

    url: str | None = None
    reconnect: bool = True
    fps: float | None = _optional(1.0, 240.0)


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """The link: URL as udpin://HOST:PORT, udpout://, tcpout:// or serial:///dev/NAME:BAUD.

    backend: setpoints flies the vehicle in OFFBOARD or GUIDED; follow-target publishes the target to its own follow
    mode, which then decides distance and height. system_id: null takes the first autopilot heard. timeout_s: how
    long to wait for it. accept_parameters: names that the audit calls unsafe and you take as they are, as
    [COM_RC_OVERRIDE]. signing_key: the file of the key (see `gcs keys`), never the key itself; null leaves the link
    unsigned. simulated: true marks page, film and stream with SIM.
    """

    url: str = "udpin://0.0.0.0:14540"
    autopilot: AutopilotChoice = AutopilotChoice.AUTO
    backend: Backend = Backend.SETPOINTS
    system_id: int | None = _whole(1, None, 254)
    takeoff_height_m: float = _ranged(2.0, 10.0, 100.0)
    timeout_s: float = _ranged(1.0, 15.0, 300.0)
    accept_parameters: tuple[str, ...] = ()
    signing_key: str | None = None
    simulated: bool = False

    def __post_init__(self) -> None:
        for name in self.accept_parameters:
            if name not in KNOWN:
                raise ValueError(f"accept_parameters: {name!r} is none of {', '.join(sorted(KNOWN))}")


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """What is kept of a flight or dry run, under `folder`; size_limit_mb: of the message log.

    keep_gb: of all flights there by their own names (flight-20260504-103000) together; the oldest are removed for the
    newest. null keeps all.
    """

    folder: str = "out"
    messages: bool = True
    video: bool = True
    tlog: bool = True
    size_limit_mb: float = _ranged(1.0, 2000.0, 100_000.0)
    keep_gb: float | None = field(default=20.0, metadata={"low": 0.1, "high": 1e6})


@dataclass(frozen=True, slots=True)
class Config:
    """All of it."""

    video: VideoConfig = field(default_factory=VideoConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    gimbal: GimbalConfig = field(default_factory=GimbalConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    recorder: RecorderConfig = field(default_factory=RecorderConfig)
    page: PageConfig = field(default_factory=PageConfig)
    mavlink_camera: MavlinkCameraConfig = field(default_factory=MavlinkCameraConfig)
    video_out: VideoOutConfig = field(default_factory=VideoOutConfig)
    control: ControlConfig = field(default_factory=ControlConfig)

    def camera_model(self, width_px: int, height_px: int) -> CameraModel:
        """The camera for pictures of this size; on a gimbal it has no mount but that. ConfigError as `CameraConfig`."""
        model = self.camera.model(width_px, height_px)
        return replace(model, mount_rpy_rad=(0.0, 0.0, 0.0)) if self.gimbal.enabled else model


def load(path: str | Path | None, profile: str | None = None) -> Config:
    """The configuration of a file over a profile's over the defaults. Raises ConfigError with file, line and key."""
    return load_with_origins(path, profile).value


def load_with_origins(path: str | Path | None, profile: str | None = None) -> Layered[Config]:
    """The same, and where each value that is no default was written."""
    layers = [] if profile is None else [profile_path(profile)]
    return load_layers([*layers, *([] if path is None else [Path(path)])], Config)
