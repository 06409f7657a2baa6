"""What a browser asks for, as an order to the station."""

from __future__ import annotations

from control.modes import FollowMode
from gcs.errors import SelectionError
from gcs.operator import orders, playback
from gcs.operator.station import Station
from gcs.operator.web import protocol as ask
from gcs.video import Frame
from tracker.box import Box


def order_of(asked: ask.Asked, station: Station) -> orders.Order:
    """Raises GcsError or ValueError with what is wrong, for the operator."""
    match asked:
        case ask.Select(box=xywh, frame=seq):
            box = Box.from_xywh(*xywh)
            if not box.is_valid:
                raise SelectionError("the box is empty: draw it larger")
            return orders.Select(box, _frame(station, seq))
        case ask.PointAt(x=x_px, y=y_px, frame=seq):
            return orders.SelectPoint(x_px, y_px, _frame(station, seq))
        case ask.Candidate(number=number):
            return orders.SelectCandidate(number)
        case ask.Deselect():
            return orders.Deselect()
        case ask.Confirm():
            return orders.Confirm()
        case ask.Abort():
            return orders.Abort()
        case ask.Ack():
            return orders.Acknowledge()
        case ask.Mode(mode=mode):
            return orders.SetMode(_mode(mode))
        case ask.Standoff(m=standoff_m):
            return orders.SetStandoff(_positive_m(standoff_m))
        case ask.Step(m=by_m):
            return orders.StepStandoff(by_m)
        case ask.Distance(m=distance_m):
            return orders.SetDistance(_positive_m(distance_m))
        case ask.Hold():
            return orders.Hold()
        case ask.Takeoff(height_m=height_m):
            return orders.TakeOff(_positive_m(height_m))
        case ask.Land():
            return orders.Land()
        case ask.Return():
            return orders.Return()
        case ask.Record(on=on):
            return orders.Record(on)
        case ask.Accept(name=name):
            return orders.Accept(name.strip().upper())
        case _:
            raise ValueError(f"{type(asked).__name__} is no order")


def playback_order_of(asked: ask.Asked) -> playback.PlaybackOrder | None:
    """How a recording is to be played; None: it is about something else."""
    match asked:
        case ask.Play(on=on):
            return playback.Play(on)
        case ask.Seek(t_s=t_s):
            return playback.Seek(t_s)
        case ask.Speed(times=times):
            return playback.Speed(times)
        case ask.Frames(by=by):
            return playback.Frames(by)
        case _:
            return None


def _frame(station: Station, seq: int) -> Frame:
    frame = station.frames.by_seq(seq)
    if frame is None:
        raise SelectionError("that picture is too old: draw again")
    return frame


def _mode(name: str) -> FollowMode:
    try:
        return FollowMode(name)
    except ValueError:
        raise ValueError(f"no mode {name!r}: one of {', '.join(mode.value for mode in FollowMode)}") from None


def _positive_m(value_m: float | None) -> float | None:
    if value_m is not None and value_m <= 0:
        raise ValueError(f"{value_m:g} m: must be more than 0")
    return value_m
