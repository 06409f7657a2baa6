"""An MCAP file read back: every message beside the schema that it came with."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

Messages = dict[str, list[tuple[int, Any]]]  # by topic: time in ns, decoded JSON


def read_mcap(path: Path) -> tuple[Messages, dict[str, dict[str, Any]], dict[str, str]]:
    """Messages and schema by topic, and the schema's name by topic."""
    messages: Messages = defaultdict(list)
    schemas, names = {}, {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            schemas[channel.topic], names[channel.topic] = json.loads(schema.data), schema.name
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
    return messages, schemas, names
