"""The operator's page: its address, its life, its routes. Importing this brings neither OpenCV nor the network.

It is there from the program's first second and says what is waited for, until a station is attached.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from aiohttp import WSCloseCode, web

from gcs.clock import Clock
from gcs.errors import PageError, one_line
from gcs.operator.addresses import bound_socket, reachable_url
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web import webrtc
from gcs.operator.web.audience import Audience
from gcs.operator.web.connections import Connection, Connections
from gcs.operator.web.guard import Guard
from gcs.operator.web.middleware import add_headers, make_open, middleware
from gcs.operator.web.mjpeg import MjpegStream
from gcs.operator.web.protocol import Asked, Ping
from gcs.operator.web.report_types import Starting, Welcome
from gcs.operator.web.static_files import read_all
from gcs.operator.web.viewer import Viewer

if TYPE_CHECKING:  # these bring OpenCV: only once there is a station
    from gcs.operator.station import Station
    from gcs.operator.web.stage import Stage

_HEARTBEAT_S: Final = 10.0  # of a WebSocket; half of it later who does not answer has gone
_BODY_BYTES: Final = 64 * 1024
_CLOSE_S: Final = 1.0
_REMIND_S: Final = 1.0
log = logging.getLogger(__name__)


class Page:
    """Serve it with `open`; all of it on one event loop.

    routes: served beside, without token. on_act: told of what viewers did, with their name.
    """

    def __init__(
        self,
        config: PageConfig,
        clock: Clock,
        *,
        lease: Lease,
        routes: Iterable[web.AbstractRouteDef] = (),
        on_act: Callable[[str, str], None] = lambda name, text: None,
    ) -> None:
        self.guard = Guard(config.token, config.names)
        self.files = read_all()
        self.on_act = on_act
        self._config, self._clock, self._lease = config, clock, lease
        self._audience = Audience(config.most_viewers)
        self._starting = "starting"
        self._stage: Stage | None = None
        self._reminding: asyncio.Task[None] | None = None
        self._ending: list[asyncio.Task[None]] = []
        self._names = 0
        self._port = config.port
        self._connections = Connections()
        self._runner = web.AppRunner(self._app(tuple(routes)), shutdown_timeout=_CLOSE_S, handle_signals=False)

    # -- life ----------------------------------------------------------------------------------------------

    async def open(self) -> None:
        """Raises PageError where the address is taken or not ours."""
        await self._runner.setup()
        try:
            listening = bound_socket(self._config.host, self._config.port)
            assert self._runner.server is not None
            await self._connections.listen(self._runner.server, listening)
        except OSError as error:
            await self._runner.cleanup()
            where = f"{self._config.host}:{self._config.port}"
            raise PageError(f"page: {where} cannot be served: {error.strerror or error}; see page.port") from None
        self._port = listening.getsockname()[1]
        self._reminding = asyncio.get_running_loop().create_task(self._remind())

    async def _remind(self) -> None:
        """Who hears nothing takes the connection for dead."""
        while True:
            if self._stage is None:
                self._audience.put("station", Starting(text=self._starting).encode())
            await asyncio.sleep(_REMIND_S)

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._port

    @property
    def url(self) -> str:
        """For people to click; as secret as the token in it."""
        return reachable_url("http", self._config.host, self._port, f"/?token={self.guard.token}")

    def starting(self, text: str) -> None:
        """What is waited for, shown until a station is attached."""
        self._starting = one_line(text)
        if self._stage is None:
            self._audience.starting(self._starting)

    def attach(self, station: Station) -> None:
        """Show and steer this one from now on."""
        from gcs.operator.web.stage import Stage

        self.detach()
        self._stage = Stage(station, self._config, self._audience, self._lease, self._clock, self._told)
        for looker in self._audience:
            if isinstance(looker, Viewer):
                self._welcome(looker, self._stage)

    def detach(self) -> None:
        """The station goes; pages are told what `starting` said last."""
        stage, self._stage = self._stage, None
        if stage is not None:
            stage.close()
            self._audience.starting(self._starting)
            self._ending.append(asyncio.get_running_loop().create_task(stage.close_peers()))

    def say(self, text: str) -> None:
        """A line for everybody's list of messages."""
        self._audience.say(one_line(text), self._clock.now_s())

    async def close(self) -> None:
        """Everybody has to leave; the address is free again."""
        self.detach()
        if self._reminding is not None:
            self._reminding.cancel()
        await self._audience.close(WSCloseCode.GOING_AWAY, "the station has ended")
        await asyncio.gather(*self._ending)
        self._connections.close()
        await self._runner.cleanup()

    def _told(self, viewer: Viewer | None, name: str, text: str) -> None:
        text = one_line(text)
        self._audience.say(f"{name}: {text}", self._clock.now_s(), but=viewer)
        log.info("%s: %s", name, text)
        self.on_act(name, text)

    # -- routes --------------------------------------------------------------------------------------------

    def _app(self, routes: tuple[web.AbstractRouteDef, ...]) -> web.Application:
        app = web.Application(
            middlewares=[middleware(self.guard, self._clock, self._connections)], client_max_size=_BODY_BYTES
        )
        app.on_response_prepare.append(add_headers)
        app.add_routes(
            [
                web.get("/", self._index),
                web.get("/static/{name}", self._static),
                web.get("/ws", self._ws, allow_head=False),
                web.get("/video.mjpg", self._video, allow_head=False),
                web.get("/snapshot.jpg", self._snapshot),
                web.get("/status.json", self._status),
                web.post("/abort", self._abort),
                web.post("/webrtc", self._webrtc),
            ]
        )
        for resource_route in app.add_routes(routes):
            make_open(app, resource_route)
        return app

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return self._file("index.html")

    async def _static(self, request: web.Request) -> web.StreamResponse:
        return self._file(request.match_info["name"])

    def _file(self, name: str) -> web.Response:
        file = self.files.get(name)
        if file is None:
            raise web.HTTPNotFound
        return web.Response(body=file.body, content_type=file.type, charset="utf-8" if file.is_text else None)

    async def _ws(self, request: web.Request) -> web.StreamResponse:
        ws = web.WebSocketResponse(
            max_msg_size=_BODY_BYTES, compress=False, heartbeat=_HEARTBEAT_S, timeout=_CLOSE_S,
            writer_limit=_BODY_BYTES, autoping=False,
        )  # fmt: skip
        await ws.prepare(request)
        self._names += 1
        assert request.transport is not None
        viewer = Viewer(f"page {self._names}", ws, self._clock, request.transport.pause_reading)
        if self._audience.is_full:
            await viewer.close(WSCloseCode.TRY_AGAIN_LATER, f"{len(self._audience)} are looking already")
            return ws
        self._audience.enter(viewer)
        _looks(request)
        try:
            self._greet(viewer)
            await viewer.run(self._handle)
        finally:
            self._audience.leave(viewer)
            self._lease.release(viewer.name)  # whoever comes back, by a reload too, may order at once
            if request.transport is not None:
                request.transport.abort()  # what a slow one has not taken until now is for nobody
        return ws

    def _greet(self, viewer: Viewer) -> None:
        if self._stage is None:
            viewer.put("station", Starting(text=self._starting).encode())
        else:
            self._welcome(viewer, self._stage)

    def _welcome(self, viewer: Viewer, stage: Stage) -> None:
        station = stage.station
        welcome = Welcome(
            viewer=viewer.name,
            size=station.size,
            watermark=station.watermark,
            webrtc=stage.peers is not None,
            version=stage.version,
            replay=stage.is_replay,
        )
        viewer.put("station", welcome.encode())
        stage.feed.catch_up()

    async def _handle(self, viewer: Viewer, asked: Asked) -> None:
        if self._stage is not None:
            await self._stage.orders.handle(viewer, asked)
        elif isinstance(asked, Ping):
            viewer.answer(asked, True, "")
        else:
            viewer.answer(asked, False, f"not yet: {self._starting}")

    async def _video(self, request: web.Request) -> web.StreamResponse:
        if self._audience.is_full:
            raise web.HTTPServiceUnavailable(text=f"{len(self._audience)} are looking already")
        stream = MjpegStream()
        self._audience.enter(stream)
        _looks(request)
        try:
            if self._stage is not None:
                self._stage.feed.catch_up()
            return await stream.run(request)
        finally:
            self._audience.leave(stream)

    async def _snapshot(self, request: web.Request) -> web.StreamResponse:
        picture = await self._present().picture()
        if picture is None:
            raise web.HTTPServiceUnavailable(text="no picture has come yet")
        return web.Response(body=bytes(picture.jpeg), content_type="image/jpeg")

    async def _status(self, request: web.Request) -> web.StreamResponse:
        if self._stage is None:
            return web.Response(body=Starting(text=self._starting).encode(), content_type="application/json")
        return web.Response(body=self._stage.feed.status().encode(), content_type="application/json")

    async def _abort(self, request: web.Request) -> web.StreamResponse:
        ok, text = await self._present().orders.abort(f"page at {request.remote}")
        return web.json_response({"ok": ok, "text": text}, status=200 if ok else 409)

    async def _webrtc(self, request: web.Request) -> web.StreamResponse:
        return await webrtc.answer(self._present().peers, request)

    def _present(self) -> Stage:
        if self._stage is None:
            raise web.HTTPServiceUnavailable(text=f"not yet: {self._starting}")
        return self._stage


def _looks(request: web.Request) -> None:
    """It takes one of the viewers' places."""
    if isinstance(request.protocol, Connection):
        request.protocol.is_looking = True
