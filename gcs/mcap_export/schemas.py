"""What the messages of an exported flight look like, as JSON schemas.

Foxglove knows its own kinds by name, so theirs are Foxglove's very own schemas. Ours follow from the types that a
flight is made of: fields keep their names, with the units in them. Only what Foxglove's reader takes is used: each
field has one type, no array holds arrays, and a value that is not known is left out, never null.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, Final

import msgspec
from msgspec import inspect

Schema = dict[str, Any]
_FILE: Final = "foxglove_schemas.json"
_PLAIN: Final[dict[type[inspect.Type], str]] = {
    inspect.BoolType: "boolean", inspect.IntType: "integer", inspect.FloatType: "number", inspect.StrType: "string",
    inspect.EnumType: "string",
}  # fmt: skip


@cache
def foxglove_schemas() -> dict[str, Schema]:
    """By name, as `foxglove.Log`."""
    schemas: dict[str, Schema] = json.loads((files(__package__) / _FILE).read_bytes())["schemas"]
    return schemas


def schema_of(kind: type) -> Schema:
    """Of a dataclass or msgspec Struct whose fields are plain values, enums, sequences and others of its like."""
    return {"title": f"gcs.{kind.__name__}", "description": _first_line(kind), **_schema(inspect.type_info(kind))}


def mavlink_schema(kind: Any) -> Schema:
    """Of a pymavlink message class: its fields, and who sent it."""
    fields: dict[str, Schema] = {name: {"type": "integer"} for name in ("system_id", "component_id", "sequence")}
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))  # in the order on the wire
    for name, of in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        plain = "string" if of == "char" else "number" if of in ("float", "double") else "integer"
        unit = kind.fieldunits_by_name.get(name)
        enum = kind.fieldenums_by_name.get(name)
        one: Schema = {"type": plain}
        field: Schema = {"type": "array", "items": one} if lengths[name] and of != "char" else one
        said = " ".join(filter(None, (enum, f"[{unit}]" if unit else None)))
        fields[name] = {**field, "description": said} if said else field
    return {"title": f"mavlink.{kind.msgname}", "type": "object", "properties": fields}


def without_gaps(value: Any) -> Any:
    """Plain values without what is not known: None, and numbers that are none. A sequence that holds one goes whole."""
    if isinstance(value, dict):
        kept = {name: without_gaps(held) for name, held in value.items()}
        return {name: held for name, held in kept.items() if held is not None}
    if isinstance(value, list | tuple):
        items = [without_gaps(held) for held in value]
        return None if any(held is None for held in items) else items
    if isinstance(value, float) and value - value != 0.0:  # NaN or infinite
        return None
    return value


def encoded(message: Any) -> bytes:
    """As JSON."""
    return msgspec.json.encode(without_gaps(msgspec.to_builtins(message)))


def _schema(of: inspect.Type) -> Schema:
    if type(of) in _PLAIN:
        return {"type": _PLAIN[type(of)]}
    if isinstance(of, inspect.UnionType):
        (known,) = (each for each in of.types if not isinstance(each, inspect.NoneType))
        return _schema(known)
    if isinstance(of, inspect.TupleType):
        return {"type": "array", "items": _schema(of.item_types[0]), "minItems": len(of.item_types)}
    if isinstance(of, inspect.VarTupleType | inspect.ListType):
        return {"type": "array", "items": _schema(of.item_type)}
    assert isinstance(of, inspect.DataclassType | inspect.StructType), of
    fields = {field.encode_name: _schema(field.type) for field in of.fields}
    return {"type": "object", "properties": fields}


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").partition("\n")[0]
