"""The camera as a MAVLink component: messages in, messages and orders out. No I/O, and time is an argument."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from control.engagement import State
from gcs.framing import Message
from gcs.operator.attendance import Absence, Attendance
from gcs.operator.camera import commands, messages
from gcs.operator.camera.clients import Client, Clients
from gcs.operator.camera.commands import Command, InvalidCommandError
from gcs.operator.camera.facts import Facts, Where
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Answer, Ask, Orders, Problem
from gcs.operator.camera.parameters import Parameters
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.camera.view import TrackingView
from gcs.operator.lease import Lease
from gcs.operator.orders import Abort
from gcs.operator.station import Station
from gcs.transport import Peer

_HEARTBEAT_S: Final = 1.0
_DEFAULT_S: Final = 0.5
_DEFAULTS: Final = {
    messages.IMAGE_STATUS: _DEFAULT_S,
    messages.GEO_STATUS: _DEFAULT_S,
}  # others are silent unless asked
_READ: Final = frozenset(
    {"HEARTBEAT", "COMMAND_LONG", "COMMAND_INT", "PARAM_EXT_REQUEST_READ", "PARAM_EXT_REQUEST_LIST", "PARAM_EXT_SET"}
)
# What is asked for by a command of its own: which message, and which parameter says "do it" (0: it always does).
_REQUESTS: Final = {
    commands.REQUEST_CAMERA_INFORMATION: (messages.INFORMATION, 1),
    commands.REQUEST_CAMERA_SETTINGS: (messages.SETTINGS, 1),
    commands.REQUEST_STORAGE_INFORMATION: (messages.STORAGE, 2),
    commands.REQUEST_CAMERA_CAPTURE_STATUS: (messages.CAPTURE, 1),
    commands.REQUEST_VIDEO_STREAM_INFORMATION: (messages.STREAM, 0),
    commands.REQUEST_VIDEO_STREAM_STATUS: (messages.STREAM_STATUS, 0),
}
_TOLD: Final = frozenset({State.LOST_HOLD, State.RELEASED, State.TAKEN_OVER})  # following has ended, or stands still


@dataclass(frozen=True, slots=True)
class Say:
    """A line for the people at the ground station."""

    text: str


@dataclass(frozen=True, slots=True)
class Out:
    """A message for one address; None: to the only one there is."""

    message: Message
    peer: Peer | None


class CameraComponent:
    """Each call returns what is to be sent, in this order, and what is to be asked of the station.

    Every `Ask` is answered with `settled`. where: the target's place, None where it cannot be told; without it the
    camera does not claim to know.
    """

    def __init__(
        self, setup: CameraSetup, station: Station, lease: Lease, now_s: float, where: Where | None = None
    ) -> None:
        self.setup = setup
        self.view = TrackingView(station.size)
        self._station = station
        self._facts = Facts(setup, station, self.view, now_s, where)
        self._state = station.status().state
        self._clients = Clients()
        self._orders = Orders(setup, station, lease)
        self._parameters = Parameters(setup, station)
        self._lease = lease
        self._attendance = Attendance(setup.abandoned_s)
        self._absence = Absence.NONE
        self._text_number = 0
        self._heartbeat_s = now_s
        self._out: list[Out] = []
        self._asks: list[Ask | Say] = []

    # -- in -----------------------------------------------------------------------------------------------

    def received(self, message: Message, peer: Peer | None, now_s: float) -> list[Out | Ask | Say]:
        """A valid message from this address."""
        setup, kind = self.setup, message.get_type()
        client = Client(peer, message.get_srcSystem(), message.get_srcComponent())
        itself = (client.system_id, client.component_id) == (setup.system_id, setup.component_id)
        is_new = peer not in self._clients.peers()
        if kind not in _READ or itself or not self._clients.heard(client, now_s):
            return []
        if is_new:
            self._send(messages.heartbeat(), peer)
        if kind == "HEARTBEAT":
            self._orders.present(client, now_s)
        elif kind in ("COMMAND_LONG", "COMMAND_INT"):
            command = commands.command_of(message, client, setup.system_id, setup.component_id)
            if command is not None:
                self._command(command, now_s)
        elif message.target_system in (0, setup.system_id) and message.target_component in (0, setup.component_id):
            self._parameter(message, kind, client, now_s)
        return self._take()

    def knows(self, peer: Peer | None) -> bool:
        """A client speaks from this address."""
        return self._clients.knows(peer)

    def tick(self, now_s: float) -> list[Out | Ask | Say]:
        """What is due by now."""
        if now_s >= self._heartbeat_s:
            self._heartbeat_s = max(self._heartbeat_s + _HEARTBEAT_S, now_s + _HEARTBEAT_S / 2)
            self._clients.forget_silent(now_s)
            status = self._station.status()
            self._facts.note_filming(status, now_s)
            for peer in self._clients.peers() or (None,):
                self._send(messages.heartbeat(), peer)
                if status.state is not self._state and status.state in _TOLD:
                    self._say(status.headline, peer)
            self._state = status.state
            self._attend(status.is_engaged, now_s)
            self._tell_changes()
        for peer, message_id in self._clients.due(now_s):
            made = self._facts.message(message_id, now_s)
            if made is not None:
                self._send(made, peer)
        self._answer_all(self._orders.overdue(now_s))
        return self._take()

    @property
    def due_s(self) -> float:
        """When `tick` has something to do next."""
        return min(self._heartbeat_s, self._clients.due_s, self._orders.due_s)

    def settled(self, ask: Ask, problem: Problem | None, now_s: float) -> list[Out | Ask | Say]:
        """The station has performed it; or what kept it from that."""
        if problem is None:
            self._parameters.performed(ask.order)
            self._attendance.took(now_s)
        self._answer_all(self._orders.settled(ask, problem))
        self._tell_changes()
        return self._take()

    def _attend(self, engaged: bool, now_s: float) -> None:
        """A follow that a client began ends when none of them is there any more."""
        before, holder = self._absence, self._lease.holder(now_s)
        elsewhere = holder not in ("", *self._clients.names())
        self._absence = self._attendance.look(now_s, self._clients.heard_s, engaged=engaged, elsewhere=elsewhere)
        if self._absence is Absence.LONG and before is Absence.NONE:
            left_s = self._attendance.left_s(now_s)
            self._asks.append(Say(f"MAVLink camera: no client is heard: the follow ends in {left_s:.0f} s"))
        elif self._absence is Absence.TOO_LONG:
            self._asks.append(Ask(Abort(), Client(None, 0, 0), 0))
            if before is not Absence.TOO_LONG:
                self._asks.append(Say("MAVLink camera: no client is heard any more: stopped and holding"))

    # -- commands -----------------------------------------------------------------------------------------

    def _command(self, command: Command, now_s: float) -> None:
        try:
            if commands.is_elsewhere(command) and not commands.names_camera(command, self.setup.component_id):
                return
            if not commands.names_camera(command, self.setup.component_id):
                raise InvalidCommandError("there is no camera of this id")
            self._do(command, now_s)
        except InvalidCommandError as error:
            self._ack(command, Result.DENIED)
            if command.number in commands.ORDERING:
                self._say(str(error), command.client.peer)

    def _do(self, command: Command, now_s: float) -> None:
        number = command.number
        if number in commands.ORDERING:
            self._answer_all(self._orders.take(command, now_s))
        elif number in _REQUESTS:
            message_id, switch = _REQUESTS[number]
            self._request(command, message_id, now_s, wanted=not switch or command.whole(switch) == 1)
        elif number == commands.REQUEST_MESSAGE:
            self._request(command, command.whole(1), now_s)
        elif number == commands.SET_MESSAGE_INTERVAL:
            self._set_interval(command, now_s)
        elif number == commands.GET_MESSAGE_INTERVAL:
            self._get_interval(command)
        elif number == commands.SET_CAMERA_MODE:
            self._ack(command, Result.ACCEPTED if commands.is_video_mode(command) else Result.DENIED)
        elif number == commands.VIDEO_START_STREAMING and self.setup.stream_url:
            self._ack(command, Result.ACCEPTED)  # it always runs
        elif not command.to_all:
            self._ack(command, Result.UNSUPPORTED)

    def _request(self, command: Command, message_id: int, now_s: float, *, wanted: bool = True) -> None:
        """The acknowledgement, then the message."""
        if message_id not in self._facts.known and command.to_all:
            return  # somebody else's
        if message_id in (messages.STREAM, messages.STREAM_STATUS):
            stream_id = command.whole(2 if command.number == commands.REQUEST_MESSAGE else 1)
            wanted = wanted and stream_id in (0, 1)
        made = self._facts.message(message_id, now_s) if wanted else None
        self._ack(command, Result.DENIED if made is None else Result.ACCEPTED)
        if made is not None:
            self._send(made, command.client.peer)
        if made is not None and message_id == messages.STREAM_STATUS and command.number == commands.REQUEST_MESSAGE:
            # MAVSDK asks for the status alone, and learns the address only if it comes unasked.
            self._send_all(filter(None, [self._facts.message(messages.STREAM, now_s)]), command.client.peer)

    def _set_interval(self, command: Command, now_s: float) -> None:
        message_id = command.whole(1)
        if message_id not in self._facts.known and command.to_all:
            return
        can = message_id != messages.HEARTBEAT and self._facts.message(message_id, now_s) is not None
        period_s = commands.period_s(command, _DEFAULTS.get(message_id))
        self._ack(command, Result.ACCEPTED if can else Result.DENIED)
        if can:
            self._clients.want(command.client, message_id, period_s, now_s)

    def _get_interval(self, command: Command) -> None:
        message_id = command.whole(1)
        if message_id not in self._facts.known:
            if not command.to_all:
                self._ack(command, Result.DENIED)
            return
        self._ack(command, Result.ACCEPTED)
        period_s = _HEARTBEAT_S if message_id == messages.HEARTBEAT else None
        period_s = period_s or self._clients.period_s(command.client, message_id)
        self._send(messages.interval(message_id, period_s), command.client.peer)

    # -- parameters ---------------------------------------------------------------------------------------

    def _parameter(self, message: Message, kind: str, client: Client, now_s: float) -> None:
        if kind == "PARAM_EXT_SET":
            wish = self._parameters.wish(message, client)
            self._answer_all([wish] if isinstance(wish, Answer) else self._orders.take(wish, now_s))
            return
        self._clients.follow_parameters(client)
        self._send_all(self._parameters.read(message, kind), client.peer)

    def _tell_changes(self) -> None:
        peers = self._clients.parameter_peers()
        changes = self._parameters.changes() if peers else []
        for peer in peers:
            self._send_all(changes, peer)

    # -- out ----------------------------------------------------------------------------------------------

    def _ack(self, command: Command, result: Result) -> None:
        client = command.client
        self._send(messages.ack(command.number, result, client.system_id, client.component_id), client.peer)

    def _say(self, text: str, peer: Peer | None) -> None:
        self._text_number = self._text_number % 65_535 + 1
        self._send_all(messages.texts(text, self._text_number), peer)

    def _answer_all(self, answers: Iterable[Ask | Answer]) -> None:
        for answer in answers:
            if isinstance(answer, Ask):
                self._asks.append(answer)
                continue
            if answer.message is not None:
                self._send(answer.message, answer.client.peer)
            if answer.why:
                self._say(answer.why, answer.client.peer)

    def _send(self, message: Message, peer: Peer | None) -> None:
        self._out.append(Out(message, peer))

    def _send_all(self, several: Iterable[Message], peer: Peer | None) -> None:
        self._out += [Out(message, peer) for message in several]

    def _take(self) -> list[Out | Ask | Say]:
        taken: list[Out | Ask | Say] = [*self._out, *self._asks]
        self._out, self._asks = [], []
        return taken
