"""What an operator sees and steers by: the page and the video that goes out, round one station."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Final

from gcs.clock import Clock
from gcs.operator.lease import Lease

if TYPE_CHECKING:  # each is imported when it is opened
    from aiohttp.web import RouteDef

    from gcs.config import Config
    from gcs.operator.config import VideoOutConfig
    from gcs.operator.station import Station
    from gcs.operator.web.server import Page
    from gcs.video_out.out import VideoOut

_LOOK_S: Final = 1.0


class Displays:
    """say: the line to everybody; lease: who may order."""

    def __init__(self, config: Config, clock: Clock, say: Callable[[str], None]) -> None:
        self.lease = Lease()
        self._config = config
        self._clock = clock
        self._say = say
        self._page: Page | None = None

    @property
    def url(self) -> str | None:
        """Of the page, with its token; None: there is none."""
        return self._page.url if self._page is not None else None

    def say(self, text: str) -> None:
        """To the terminal and to every page."""
        self._say(text)
        if self._page is not None:
            self._page.say(text)

    def starting(self, text: str) -> None:
        """What is being waited for, while there is no station yet."""
        if self._page is not None:
            self._page.starting(text)

    async def open(self) -> None:
        """The page answers from here on. GcsError where its port is taken."""
        if not self._config.page.enabled:
            return
        from gcs.operator.web.server import Page

        self._page = Page(self._config.page, self._clock, lease=self.lease, routes=self._routes(), on_act=self._acted)
        await self._page.open()

    async def prepare(self) -> None:
        """Load what the page may need later, so that it holds up no flight."""
        if self._page is not None:
            from gcs.operator.web import webrtc

            await webrtc.prepare()

    def _routes(self) -> list[RouteDef]:
        """What a MAVLink camera's clients fetch here."""
        if self._config.mavlink_camera.url is None:
            return []
        from gcs.operator.camera.definition import routes
        from gcs.operator.camera.server import definition_of
        from gcs.operator.camera.setup import camera_setup

        return routes(definition_of(camera_setup(self._config)))

    @property
    def definition_url(self) -> str | None:
        """Of the camera definition; None: it is not served."""
        if self._page is None or self._config.mavlink_camera.url is None:
            return None
        from gcs.operator.camera.definition import PATH

        return self._page.url.partition("/?")[0] + PATH

    def _acted(self, name: str, text: str) -> None:
        self._say(f"{name}: {text}")

    async def close(self) -> None:
        """Everything that is open."""
        if self._page is not None:
            await self._page.close()

    @contextlib.asynccontextmanager
    async def serve(self, station: Station) -> AsyncIterator[VideoOut | None]:
        """Show and steer this station; gives the video that goes out, None where there is none."""
        async with contextlib.AsyncExitStack() as opened:
            if self._page is not None:
                self._page.attach(station)
                opened.callback(self._page.detach)
            video = await self._open_video(station)
            if video is not None:
                opened.push_async_callback(video.close)
                telling = asyncio.create_task(self._tell(video))
                opened.callback(telling.cancel)
            yield video

    async def _tell(self, video: VideoOut) -> None:
        """What goes wrong with the video that goes out, once each."""
        said = None
        while True:
            if video.problem != said:
                said = video.problem
                self.say(f"video out: {said or 'it goes out again'}")
            await asyncio.sleep(_LOOK_S)

    async def _open_video(self, station: Station) -> VideoOut | None:
        wanted = self._config.video_out
        if wanted.rtsp_port is None and wanted.rtp is None:
            return None
        from gcs.video_out.out import VideoOut

        video = VideoOut(wanted, station)
        await video.open()
        self.say(f"video out: {stream_url(video, wanted)}")
        return video


def stream_url(video: VideoOut, config: VideoOutConfig) -> str:
    """Where others find the video."""
    return video.rtsp_url or f"rtp://{config.rtp}"
