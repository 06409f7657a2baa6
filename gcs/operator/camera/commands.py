"""MAV_CMDs for a camera as this side understands them: checked numbers, or what is wrong with them. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gcs.framing import Message
from gcs.operator.camera.clients import Client
from gcs.operator.camera.messages import VIDEO_MODE
from gcs.operator.orders import Deselect, Order, Record, Select, SelectPoint
from gcs.video import Frame
from tracker.box import Box

GET_MESSAGE_INTERVAL: Final = 510
SET_MESSAGE_INTERVAL: Final = 511
REQUEST_MESSAGE: Final = 512
REQUEST_CAMERA_INFORMATION, REQUEST_CAMERA_SETTINGS = 521, 522
REQUEST_STORAGE_INFORMATION, REQUEST_CAMERA_CAPTURE_STATUS = 525, 527
SET_CAMERA_MODE: Final = 530
TRACK_POINT, TRACK_RECTANGLE, STOP_TRACKING = 2004, 2005, 2010
VIDEO_START_CAPTURE, VIDEO_STOP_CAPTURE = 2500, 2501
VIDEO_START_STREAMING, VIDEO_STOP_STREAMING = 2502, 2503
REQUEST_VIDEO_STREAM_INFORMATION, REQUEST_VIDEO_STREAM_STATUS = 2504, 2505

SELECTING: Final = frozenset({TRACK_POINT, TRACK_RECTANGLE})
FILMING: Final = frozenset({VIDEO_START_CAPTURE, VIDEO_STOP_CAPTURE})
ORDERING: Final = SELECTING | FILMING | {STOP_TRACKING}
# Which parameter (1 to 7) may name a camera behind our component; it must be ours, or none.
_CAMERA_ID: Final = {TRACK_POINT: 4, TRACK_RECTANGLE: 5, STOP_TRACKING: 1, SET_CAMERA_MODE: 1}
_FIRST_COMPONENT: Final = 7  # below stand cameras of an autopilot's own


class InvalidCommandError(ValueError):
    """Numbers that mean nothing; says which."""


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG or COMMAND_INT; params: 1 to 7. to_all: not addressed to this component alone."""

    number: int
    params: tuple[float, ...]
    confirmation: int
    client: Client
    to_all: bool

    def param(self, number: int) -> float:
        """Counted from 1, as in the definitions."""
        return self.params[number - 1]

    def whole(self, number: int) -> int:
        """A parameter that counts or names something; unset (NaN) is 0. InvalidCommandError for anything else."""
        value = self.param(number)
        if math.isnan(value):
            return 0
        if not math.isfinite(value) or value != int(value):
            raise InvalidCommandError(f"parameter {number} is no whole number")
        return int(value)

    def fraction(self, number: int) -> float:
        """A parameter that is a part of the picture. InvalidCommandError outside 0 to 1."""
        value = self.param(number)
        if not 0.0 <= value <= 1.0:  # NaN neither
            raise InvalidCommandError(f"parameter {number} is not in 0 to 1")
        return value

    def same_as(self, other: Command) -> bool:
        """The same wish, also where it was said again with its confirmation counted up."""
        return self.number == other.number and repr(self.params) == repr(other.params)  # NaN equals NaN


def command_of(message: Message, client: Client, system_id: int, component_id: int) -> Command | None:
    """The command of this message; None: it is for somebody else."""
    if message.target_system not in (0, system_id) or message.target_component not in (0, component_id):
        return None
    first = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        params, confirmation = (*first, float(message.x), float(message.y), message.z), 0
    else:
        params = (*first, message.param5, message.param6, message.param7)
        confirmation = message.confirmation
    return Command(message.command, params, confirmation, client, message.target_component != component_id)


def names_camera(command: Command, component_id: int) -> bool:
    """Whether its camera id is ours, or none at all."""
    at = _CAMERA_ID.get(command.number)
    return at is None or command.whole(at) in (0, component_id)


def is_elsewhere(command: Command) -> bool:
    """Whether its camera id is another component's, so that this one has nothing to say."""
    at = _CAMERA_ID.get(command.number)
    return command.to_all and at is not None and command.whole(at) >= _FIRST_COMPONENT


def order_of(command: Command, size_px: tuple[int, int], frame: Frame | None) -> Order:
    """What an operator asks for by it. InvalidCommandError for numbers that no picture has."""
    if command.number == TRACK_POINT:
        return _point(command, size_px, frame)
    if command.number == TRACK_RECTANGLE:
        return _rectangle(command, size_px, frame)
    if command.number == STOP_TRACKING:
        return Deselect()
    return Record(command.number == VIDEO_START_CAPTURE)


def _point(command: Command, size_px: tuple[int, int], frame: Frame | None) -> SelectPoint:
    (width, height), x, y = size_px, command.fraction(1), command.fraction(2)
    radius = 0.0 if math.isnan(command.param(3)) else command.fraction(3)
    return SelectPoint(min(x * width, width - 1.0), min(y * height, height - 1.0), frame, radius * width or None)


def _rectangle(command: Command, size_px: tuple[int, int], frame: Frame | None) -> Select:
    left, top, right, bottom = map(command.fraction, (1, 2, 3, 4))
    if left >= right or top >= bottom:
        raise InvalidCommandError("the rectangle's bottom-right corner is not right of and below the top-left one")
    width, height = size_px
    box = Box.from_xywh(left * width, top * height, (right - left) * width, (bottom - top) * height)
    return Select(box, frame)


def period_s(command: Command, default_s: float | None) -> float | None:
    """What SET_MESSAGE_INTERVAL asks for; None: nothing any more. InvalidCommandError where that is no time."""
    period_us = command.param(2)
    if period_us == -1:
        return None
    if period_us == 0:
        return default_s
    if not 0 < period_us < 2**31:  # what MESSAGE_INTERVAL can tell
        raise InvalidCommandError("the interval is no time")
    return period_us / 1e6


def is_video_mode(command: Command) -> bool:
    """Of SET_CAMERA_MODE: the only mode there is."""
    return command.whole(2) == VIDEO_MODE
