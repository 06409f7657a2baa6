"""STATUSTEXT put together again: long texts come in chunks of 50 characters."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.framing import Message

_CHUNK_CHARS = 50
_MAX_CHUNKS = 16
_MAX_UNFINISHED = 8
_UNFINISHED_S = 1.0


@dataclass(frozen=True, slots=True)
class StatusText:
    """A text of the vehicle; severity is MAV_SEVERITY (0 emergency .. 4 warning .. 7 debug)."""

    t_s: float
    severity: int
    text: str


@dataclass(slots=True)
class _Unfinished:
    t_s: float
    severity: int
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None  # number of the last chunk, once it has come

    def whole(self) -> str | None:
        if self.last is None or any(number not in self.chunks for number in range(self.last + 1)):
            return None
        return "".join(self.chunks[number] for number in range(self.last + 1))

    def torn(self) -> str:
        end = self.last if self.last is not None else max(self.chunks) + 1
        return "".join(self.chunks.get(number, " … ") for number in range(end + 1)).strip()


class StatusTextAssembler:
    """Gives a text when its last chunk is there, or after 1 s with … for what was lost."""

    def __init__(self) -> None:
        self._unfinished: dict[tuple[int, int, int], _Unfinished] = {}

    def add(self, message: Message, t_s: float) -> list[StatusText]:
        """Texts finished by this STATUSTEXT, which arrived at t_s."""
        done = self.expire(t_s)
        if message.id == 0:
            return [*done, StatusText(t_s, message.severity, _clean(message.text))]
        key = (message.get_srcSystem(), message.get_srcComponent(), message.id)
        text = self._unfinished.setdefault(key, _Unfinished(t_s, message.severity))
        if message.chunk_seq < _MAX_CHUNKS:
            text.chunks[message.chunk_seq] = message.text
            if len(message.text) < _CHUNK_CHARS:
                text.last = message.chunk_seq
        whole = text.whole()
        if whole is not None:
            del self._unfinished[key]
            done.append(StatusText(text.t_s, text.severity, _clean(whole)))
        while len(self._unfinished) > _MAX_UNFINISHED:
            self._unfinished.pop(next(iter(self._unfinished)))
        return done

    def expire(self, now_s: float) -> list[StatusText]:
        """Texts whose missing chunks are not waited for any longer."""
        old = [key for key, text in self._unfinished.items() if now_s - text.t_s > _UNFINISHED_S]
        torn = [self._unfinished.pop(key) for key in old]
        return [StatusText(text.t_s, text.severity, _clean(text.torn())) for text in torn if text.chunks]


def _clean(text: str) -> str:
    """PX4 ends its texts in a tab; nothing unprintable may reach a terminal."""
    return "".join(character for character in text if character.isprintable()).strip()
