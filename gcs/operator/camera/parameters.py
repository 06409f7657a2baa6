"""The camera's parameters with their values: read, listed, wished for, and told when they change. No I/O."""

from __future__ import annotations

from gcs.framing import Message
from gcs.operator.camera.clients import Client
from gcs.operator.camera.orders import Answer, SetParameter
from gcs.operator.camera.parameter_types import (
    InvalidValueError,
    Parameter,
    Told,
    ack_message,
    parameters,
    raw_value,
    value_message,
    value_now,
)
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.orders import Order, SetStandoff
from gcs.operator.station import Station


class Parameters:
    """What stands behind the values is the station's."""

    def __init__(self, setup: CameraSetup, station: Station) -> None:
        self._station = station
        self._all = parameters(setup)
        self._by_name = {parameter.name: parameter for parameter in self._all}
        self._wanted_standoff_m = 0.0  # as last set from here; what holds now, the status tells
        self._told = self._values()

    def read(self, message: Message, kind: str) -> list[Message]:
        """What PARAM_EXT_REQUEST_READ or _LIST asks for; nothing for what does not exist."""
        values = self._values()
        if kind == "PARAM_EXT_REQUEST_LIST":
            return [self._message(parameter, values) for parameter in self._all]
        at = message.param_index
        found = self._by_name.get(message.param_id) if at < 0 else self._at(at)
        return [] if found is None else [self._message(found, values)]

    def wish(self, message: Message, client: Client) -> SetParameter | Answer:
        """What PARAM_EXT_SET is to do, or the answer where it cannot be done."""
        name, data, kind = bytes(message._param_id_raw), raw_value(message), message.param_type
        found = self._by_name.get(message.param_id)
        if found is None:
            told = ack_message(name, data, kind, Told.REFUSED)
            return Answer(client, told, f"there is no parameter {_printable(message.param_id)}")
        current = found.bytes_of(self._values()[found.name])
        try:
            value = found.value_of(data, kind)
        except InvalidValueError as error:
            return Answer(client, ack_message(name, current, int(found.kind), Told.REFUSED), str(error))
        assert found.order is not None  # or it would have been refused
        return SetParameter(client, name, data, kind, current, found.order(value))

    def performed(self, order: Order) -> None:
        """The station has done what was ordered from here."""
        if isinstance(order, SetStandoff):
            self._wanted_standoff_m = order.standoff_m or 0.0

    def changes(self) -> list[Message]:
        """What is not as it was last told."""
        values = self._values()
        changed = [self._message(parameter, values) for parameter in self._all if self._differs(parameter, values)]
        self._told = values
        return changed

    def _differs(self, parameter: Parameter, values: dict[str, float]) -> bool:
        return parameter.bytes_of(values[parameter.name]) != parameter.bytes_of(self._told[parameter.name])

    def _values(self) -> dict[str, float]:
        status = self._station.status()
        return {parameter.name: value_now(parameter.name, status, self._wanted_standoff_m) for parameter in self._all}

    def _at(self, index: int) -> Parameter | None:
        return self._all[index] if index < len(self._all) else None

    def _message(self, parameter: Parameter, values: dict[str, float]) -> Message:
        value = values[parameter.name]
        return value_message(parameter, value, len(self._all), self._all.index(parameter))


def _printable(name: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in name) or "without a name"
