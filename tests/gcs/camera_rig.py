"""A MAVLink camera without sockets, on a fake clock, and what stands round it."""

from __future__ import annotations

from gcs.framing import Deframer, Encoder, dialect
from gcs.operator.camera.component import CameraComponent, Out
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask, Problem
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.lease import Lease
from tests.gcs.fake_station import FakeStation

PEER, OTHER = ("127.0.0.1", 40_001), ("127.0.0.1", 40_002)
GCS = (255, 190)
SETUP = CameraSetup(7, may_follow=True)
BOX = (0.25, 0.25, 0.5, 0.75)


class Rig:
    """A component with what stands round it; times in s."""

    def __init__(self, setup: CameraSetup = SETUP, *, shows: bool = True) -> None:
        self.now_s = 100.0
        self.station = FakeStation(size=(320, 240), now_s=lambda: self.now_s)
        self.lease = Lease()
        self.component = CameraComponent(setup, self.station, self.lease, self.now_s)
        self.station.watch(self.component.view)
        self.codecs: dict[tuple[int, int], tuple[Encoder, Deframer]] = {}
        if shows:
            self.station.show()

    def hears(self, message, peer=PEER, source=GCS):
        """What it answers to this message, which goes through the wire's bytes."""
        encoder, deframer = self.codecs.setdefault(source, (Encoder(*source), Deframer()))
        (heard,) = deframer.datagram(encoder.encode(message))
        return self.component.received(heard, peer, self.now_s)

    def command(self, number, *params, confirmation=0, peer=PEER, source=GCS):
        seven = (*params, *[0.0] * (7 - len(params)))
        return self.hears(dialect.MAVLink_command_long_message(7, 100, number, confirmation, *seven), peer, source)

    def sets(self, name, value, kind=1):
        return self.hears(dialect.MAVLink_param_ext_set_message(7, 100, name.encode(), value, kind))

    def passes(self, seconds, step_s=0.01):
        """What it says in this time: (s, message)."""
        said = []
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            said += [(self.now_s, each) for each in self.component.tick(self.now_s)]
        return said

    def settles(self, ask, why="", result=Result.TEMPORARILY_REJECTED):
        return self.component.settled(ask, Problem(result, why) if why else None, self.now_s)


def kinds(said):
    return [each.message.get_type() if isinstance(each, Out) else type(each.order).__name__ for each in said]


def results(said):
    acks = [each.message for each in said if isinstance(each, Out) and each.message.get_type() == "COMMAND_ACK"]
    return [ack.result for ack in acks]


def ask_in(said):
    (ask,) = (each for each in said if isinstance(each, Ask))
    return ask


def statuses(said):
    return [t for t, each in said if each.message.get_type() == "CAMERA_TRACKING_IMAGE_STATUS"]
