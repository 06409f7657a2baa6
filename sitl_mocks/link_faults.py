"""A bad link: loss, delay, jitter, duplicates, reordering, flipped bits, cut datagrams, one or both ways closed.

The core is pure and seeded: `OneWay.send(datagram, now_s)` gives (due time, datagram) pairs, so a test can run it on
any clock. Around it is a UDP proxy: `python -m sitl_mocks.link_faults --listen 127.0.0.1:14541 --to 127.0.0.1:14540
--loss 0.2 --delay-ms 100` stands between a vehicle told to send to 14541 and a station listening on 14540. A line of
the same options on its stdin replaces the conditions while it runs with --orders.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import heapq
import itertools
import json
import math
import os
import random
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, NoReturn

Address = tuple[str, int]
_MAX_CLIENTS = 16


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a link does to datagrams in one direction: shares of them (0 to 1) and times in s.

    jitter_s: added to the delay, uniform from 0, order kept. reorder_frac: held back by reorder_s so that later ones
    overtake. corrupt_frac: one to eight bits flipped. truncate_frac: cut at a random length. closed: nothing passes.
    Raises ValueError for a share outside 0 to 1 or a time that is negative or not finite.
    """

    loss_frac: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    duplicate_frac: float = 0.0
    reorder_frac: float = 0.0
    reorder_s: float = 0.1
    corrupt_frac: float = 0.0
    truncate_frac: float = 0.0
    closed: bool = False

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            most = 1.0 if item.name.endswith("_frac") else math.inf
            if not (math.isfinite(value) and 0.0 <= value <= most):
                raise ValueError(f"{item.name} must be between 0 and {most:g}, got {value}")


@dataclass(slots=True)
class Counts:
    """What happened so far in one direction, in datagrams."""

    seen: int = 0
    lost: int = 0
    delayed: int = 0
    duplicated: int = 0
    reordered: int = 0
    corrupted: int = 0
    truncated: int = 0


class OneWay:
    """One direction of a link. `conditions` may be replaced at any time; the same seed and calls give the same."""

    def __init__(self, conditions: Conditions | None = None, seed: int = 0) -> None:
        self.conditions = conditions or Conditions()
        self.counts = Counts()
        self._random = random.Random(seed)
        self._last_due_s = -math.inf
        self._queue: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()

    def send(self, datagram: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """What becomes of a datagram sent at now_s (s): none, one or two pairs of the time it arrives and its bytes."""
        self.counts.seen += 1
        if self.conditions.closed or self._happens(self.conditions.loss_frac):
            self.counts.lost += 1
            return []
        arrivals = [(self._due_s(now_s), self._damaged(datagram))]
        if self._happens(self.conditions.duplicate_frac):
            self.counts.duplicated += 1
            arrivals.append((self._due_s(now_s), arrivals[0][1]))
        return arrivals

    def put(self, datagram: bytes, now_s: float) -> None:
        """`send`, kept here until `take` finds it due."""
        for due_s, arriving in self.send(datagram, now_s):
            heapq.heappush(self._queue, (due_s, next(self._order), arriving))

    def take(self, now_s: float) -> list[bytes]:
        """The datagrams of `put` that have arrived by now_s, in their order of arrival."""
        arrived: list[bytes] = []
        while self._queue and self._queue[0][0] <= now_s + 1e-9:
            arrived.append(heapq.heappop(self._queue)[2])
        return arrived

    def _happens(self, share: float) -> bool:
        return share > 0.0 and self._random.random() < share

    def _due_s(self, now_s: float) -> float:
        c = self.conditions
        delay_s = c.delay_s + (self._random.uniform(0.0, c.jitter_s) if c.jitter_s > 0.0 else 0.0)
        if self._happens(c.reorder_frac):
            self.counts.reordered += 1
            return now_s + delay_s + c.reorder_s
        # A shorter delay does not overtake what is under way: only reordering does.
        self._last_due_s = max(self._last_due_s, now_s + delay_s)
        self.counts.delayed += self._last_due_s > now_s
        return self._last_due_s

    def _damaged(self, datagram: bytes) -> bytes:
        if datagram and self._happens(self.conditions.truncate_frac):
            self.counts.truncated += 1
            datagram = datagram[: self._random.randrange(len(datagram))]
        if datagram and self._happens(self.conditions.corrupt_frac):
            self.counts.corrupted += 1
            damaged = bytearray(datagram)
            for bit in self._random.sample(range(8 * len(datagram)), self._random.randint(1, 8)):
                damaged[bit // 8] ^= 1 << bit % 8
            datagram = bytes(damaged)
        return datagram


@dataclass(slots=True)
class Link:
    """Both directions. forth: from the side that is listened on to the other one, back: the way home."""

    forth: OneWay = field(default_factory=lambda: OneWay(seed=1))
    back: OneWay = field(default_factory=lambda: OneWay(seed=2))

    def set(self, conditions: Conditions) -> None:
        """The same in both directions."""
        self.forth.conditions = self.back.conditions = conditions


class _Side(asyncio.DatagramProtocol):
    def __init__(self, received: Callable[[bytes, Address], None]) -> None:
        self._received = received

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._received(data, addr[:2])

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there: a link does not care."""


class Proxy:
    """Forwards UDP through a Link. Each sender on the listening side gets a port of its own towards the other side."""

    def __init__(self, listen: Address, to: Address, link: Link | None = None) -> None:
        self.link = link or Link()
        self._listen, self._to = listen, to
        self._front: asyncio.DatagramTransport | None = None
        self._back: dict[Address, asyncio.Task[asyncio.DatagramTransport]] = {}

    @property
    def address(self) -> Address:
        """Where it listens, the real port."""
        assert self._front is not None, "the proxy is not open"
        return tuple(self._front.get_extra_info("sockname")[:2])

    async def __aenter__(self) -> Proxy:
        self._front = await _open(self._from_front, local_addr=self._listen)
        return self

    async def __aexit__(self, *_: object) -> None:
        for transport in (self._front, *await asyncio.gather(*self._back.values())):
            if transport is not None:
                transport.close()

    def _from_front(self, data: bytes, sender: Address) -> None:
        if sender not in self._back:
            if len(self._back) >= _MAX_CLIENTS:
                return
            self._back[sender] = asyncio.create_task(
                _open(lambda answer, _: self._from_back(answer, sender), remote_addr=self._to)
            )
        towards = self._back[sender]
        self._later(
            self.link.forth,
            data,
            lambda datagram: towards.add_done_callback(lambda opened: _send(opened.result(), datagram, None)),
        )

    def _from_back(self, data: bytes, client: Address) -> None:
        front = self._front
        if front is not None:
            self._later(self.link.back, data, lambda datagram: _send(front, datagram, client))

    def _later(self, way: OneWay, data: bytes, deliver: Callable[[bytes], None]) -> None:
        loop = asyncio.get_running_loop()
        for due_s, datagram in way.send(data, loop.time()):
            loop.call_at(due_s, deliver, datagram)


async def _open(received: Callable[[bytes, Address], None], **where: Any) -> asyncio.DatagramTransport:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: _Side(received), **where)
    return transport


def _send(transport: asyncio.DatagramTransport, datagram: bytes, address: Address | None) -> None:
    if not transport.is_closing():
        transport.sendto(datagram, address)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def _condition_parser() -> argparse.ArgumentParser:
    parser = _Parser(add_help=False)
    for name in ("loss", "duplicate", "reorder", "corrupt", "truncate"):
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="SHARE", help=f"share of datagrams: {name}")
    for name in ("delay", "jitter"):
        parser.add_argument(f"--{name}-ms", type=float, default=0.0, metavar="MS")
    parser.add_argument("--reorder-ms", type=float, default=100.0, metavar="MS", help="how long one is held back")
    parser.add_argument("--way", choices=("both", "forth", "back"), default="both", help="where all this applies")
    parser.add_argument("--close", choices=("neither", "both", "forth", "back"), default="neither", help="half-open")
    return parser


def _apply(options: argparse.Namespace, link: Link) -> None:
    bad = Conditions(
        options.loss, options.delay_ms / 1e3, options.jitter_ms / 1e3, options.duplicate,
        options.reorder, options.reorder_ms / 1e3, options.corrupt, options.truncate,
    )  # fmt: skip
    for name, way in (("forth", link.forth), ("back", link.back)):
        conditions = bad if options.way in ("both", name) else Conditions()
        way.conditions = replace(conditions, closed=options.close in ("both", name))


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT")
    return host, int(port)


async def _obey(link: Link) -> None:
    """Each line of stdin replaces the conditions; a bad one is answered on stderr and changes nothing."""
    lines = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    pipe, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    with contextlib.closing(pipe):
        while line := await lines.readline():
            try:
                _apply(_condition_parser().parse_args(line.decode(errors="replace").split()), link)
            except ValueError as error:
                sys.stderr.write(f"link_faults: {error}{os.linesep}")


def _say(**values: Any) -> None:
    sys.stdout.write(json.dumps(values) + "\n")
    sys.stdout.flush()


async def _run(options: argparse.Namespace) -> None:
    link, stop = Link(OneWay(seed=options.seed), OneWay(seed=options.seed + 1)), asyncio.Event()
    _apply(options, link)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    async with Proxy(options.listen, options.to, link) as proxy:
        _say(ready=True, listen="{}:{}".format(*proxy.address))
        obeying = asyncio.create_task(_obey(link)) if options.orders else None
        await stop.wait()
        if obeying is not None:
            obeying.cancel()
            await asyncio.gather(obeying, return_exceptions=True)
    _say(forth=asdict(link.forth.counts), back=asdict(link.back.counts))


def main(arguments: list[str] | None = None) -> int:
    """Run the proxy until SIGINT or SIGTERM, then print the counts; 2 with one line for what cannot be done."""
    prog = "python -m sitl_mocks.link_faults"
    parser = argparse.ArgumentParser(prog=prog, description=__doc__, parents=[_condition_parser()])
    parser.add_argument("--listen", type=_address, required=True, metavar="HOST:PORT", help="port 0 picks a free one")
    parser.add_argument("--to", type=_address, required=True, metavar="HOST:PORT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--orders", action="store_true", help="take lines of options from stdin while running")
    try:
        asyncio.run(_run(parser.parse_args(arguments)))
    except (ValueError, OSError) as error:
        sys.stderr.write(f"link_faults: {error}{os.linesep}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
