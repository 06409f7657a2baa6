"""An MCAP file by topics: each with its schema, all as JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from typing import IO, Any, Final

from gcs.errors import GcsError
from gcs.mcap_export.schemas import Schema, encoded, foxglove_schemas, schema_of

_NS: Final = 1_000_000_000


class ExportError(GcsError):
    """A flight that cannot be exported; says what is missing."""


class TopicWriter:
    """Messages into an open file; call `finish` at the end.

    unix_s: seconds since 1970 at a time of the flight's clock.
    """

    def __init__(self, file: IO[bytes], unix_s: Callable[[float], float]) -> None:
        try:
            from mcap.writer import CompressionType, Writer
        except ImportError:
            raise ExportError("MCAP needs an extra: pip install 'climrt-gcs[mcap]'") from None
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="climrt-gcs")
        self._unix_s = unix_s
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.counts: Counter[str] = Counter()

    def stamp(self, t_s: float) -> dict[str, int]:
        """A time of the flight's clock as Foxglove's messages carry it."""
        sec, nsec = divmod(self._ns(t_s), _NS)
        return {"sec": sec, "nsec": nsec}

    def put_foxglove(self, topic: str, kind: str, t_s: float, message: dict[str, Any]) -> None:
        """A message of Foxglove's own; kind: as `foxglove.Log`. A topic keeps the kind it began with."""
        self.put(topic, kind, lambda: foxglove_schemas()[kind], t_s, message)

    def put_own(self, topic: str, t_s: float, message: Any) -> None:
        """One of ours: a dataclass or Struct."""
        kind = type(message)
        self.put(topic, f"gcs.{kind.__name__}", lambda: schema_of(kind), t_s, message)

    def put(self, topic: str, kind: str, schema: Callable[[], Schema], t_s: float, message: Any) -> None:
        """Any message. schema: asked once."""
        if topic not in self._channels:
            if kind not in self._schemas:
                text = json.dumps(schema()).encode()
                self._schemas[kind] = self._writer.register_schema(kind, "jsonschema", text)
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[kind])
        ns = self._ns(t_s)
        self._writer.add_message(self._channels[topic], ns, encoded(message), ns, self.counts[topic])
        self.counts[topic] += 1

    def attach(self, name: str, media_type: str, data: bytes, t_s: float) -> None:
        """A file as it is."""
        ns = self._ns(t_s)
        self._writer.add_attachment(ns, ns, name, media_type, data)

    def note(self, name: str, facts: dict[str, str]) -> None:
        """Facts about the whole."""
        self._writer.add_metadata(name, facts)

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _ns(self, t_s: float) -> int:
        return max(round(self._unix_s(t_s) * _NS), 0)
