"""What the page's server answers beside files and feeds: pictures, the past, the background, alerts, words."""

import asyncio
import math
from collections.abc import Awaitable, Callable

import msgspec
from aiohttp import web

from service.common.degraded import Degraded
from service.ground.background.backdrop import Backdrop

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Pictures:
    """`preview` gives a vehicle's or a fire's last JPEG, `past` the crew's picture at a time, as JSON."""

    def __init__(self, preview: Callable[[str], bytes | None], past: Callable[[float], bytes | None]) -> None:
        self._preview, self._past = preview, past
        self.routes: dict[str, Handler] = {"/preview": self.preview, "/past": self.past}

    async def preview(self, request: web.Request) -> web.Response:
        jpeg = self._preview(request.query.get("fire") or request.query.get("vehicle", ""))
        if jpeg is None:
            raise web.HTTPNotFound
        return web.Response(body=jpeg, content_type="image/jpeg")

    async def past(self, request: web.Request) -> web.Response:
        try:
            time_s = float(request.query.get("t", ""))
        except ValueError as error:
            raise web.HTTPBadRequest from error
        body = self._past(time_s) if math.isfinite(time_s) else None
        if body is None:
            raise web.HTTPNotFound
        return web.Response(body=body, content_type="application/json")


class Background:
    """What lies under the fires."""

    def __init__(self, backdrop: Backdrop) -> None:
        self._backdrop = backdrop
        self.routes: dict[str, Handler] = {
            "/background": self.background,
            "/places": self.places,
            r"/tiles/{zoom:\d{1,2}}/{x:\d{1,8}}/{y:\d{1,8}}": self.tile,
        }

    async def background(self, _request: web.Request) -> web.Response:
        return web.Response(body=msgspec.json.encode(self._backdrop.told), content_type="application/json")

    async def places(self, _request: web.Request) -> web.Response:
        if self._backdrop.places is None:
            raise web.HTTPNotFound
        return web.Response(body=self._backdrop.places, content_type="application/json")

    async def tile(self, request: web.Request) -> web.Response:
        place = [int(request.match_info[name]) for name in ("zoom", "x", "y")]
        found = await asyncio.to_thread(self._backdrop.tile, *place)
        if found is None:
            return web.Response(status=204)  # beyond its edge: no fault to be told in the console
        return web.Response(body=found.image, content_type=found.kind)


class Alerts:
    """Towers' alerts by POST; `on_alert` takes one, or says why not."""

    def __init__(self, on_alert: Callable[[bytes], str | None]) -> None:
        self._on_alert = on_alert

    async def take(self, request: web.Request) -> web.Response:
        if request.content_type != "application/json":
            raise web.HTTPUnsupportedMediaType
        fault = self._on_alert(await request.read())
        if fault is None:
            return web.Response(status=202, text="taken\n")
        return web.Response(status=422, text=f"{fault}\n")


async def meanings(_request: web.Request) -> web.Response:
    """What the names of faults mean and what to do about them."""
    table = {str(one): {"meaning": one.meaning, "mend": one.mend} for one in Degraded}
    return web.Response(body=msgspec.json.encode(table), content_type="application/json")
