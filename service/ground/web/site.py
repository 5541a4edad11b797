"""The page's server: files, live channel, previews. Nothing is read but the page's own files."""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from service.common.degraded import Degraded
from service.ground.background.backdrop import Backdrop
from service.ground.web.access import Access, wants_json
from service.ground.web.feeds import Feeds
from service.ground.web.hub import Hub

PAGE = Path(__file__).resolve().parents[1] / "page"
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def site(
    access: Access,
    hub: Hub,
    preview: Callable[[str], bytes | None],
    past: Callable[[float], bytes | None],
    backdrop: Backdrop,
    feeds: Feeds,
    on_alert: Callable[[bytes], str | None],
) -> web.Application:
    """The application; `preview` gives a vehicle's or a fire's last JPEG, `past` the picture at a time, as JSON;
    at infinity as it is now. `on_alert` takes a tower's alert, or says why not."""
    application = web.Application(middlewares=[access.guard], client_max_size=64_000)

    def get(path: str, answer: _Handler) -> None:
        application.router.add_get(path, answer, expect_handler=_expect)

    for path in sorted(PAGE.rglob("*")):
        if path.suffix in _TYPES:
            name = path.relative_to(PAGE).as_posix()
            if name == "index.html":
                get("/", _page_or(_file(path), feeds.landing))
            else:
                get(f"/{name}", _file(path))
    for route, answer in feeds.routes.items():
        get(route, answer)
    get("/live", hub.handle)

    async def picture(request: web.Request) -> web.Response:
        jpeg = preview(request.query.get("fire") or request.query.get("vehicle", ""))
        if jpeg is None:
            raise web.HTTPNotFound
        return web.Response(body=jpeg, content_type="image/jpeg")

    async def earlier(request: web.Request) -> web.Response:
        asked = request.query.get("t", "")
        try:
            body = past(math.inf if asked == "now" else float(asked))
        except ValueError as error:
            raise web.HTTPBadRequest from error
        if body is None:
            raise web.HTTPNotFound
        return web.Response(body=body, content_type="application/json")

    async def meanings(_request: web.Request) -> web.Response:
        table = {str(one): {"meaning": one.meaning, "mend": one.mend} for one in Degraded}
        return web.Response(body=msgspec.json.encode(table), content_type="application/json")

    async def background(_request: web.Request) -> web.Response:
        return web.Response(body=msgspec.json.encode(backdrop.told), content_type="application/json")

    async def places(_request: web.Request) -> web.Response:
        if backdrop.places is None:
            raise web.HTTPNotFound
        return web.Response(body=backdrop.places, content_type="application/json")

    async def tile(request: web.Request) -> web.Response:
        place = [int(request.match_info[name]) for name in ("zoom", "x", "y")]
        found = await asyncio.to_thread(backdrop.tile, *place)
        if found is None:
            return web.Response(status=204)  # beyond its edge: no fault to be told in the console
        return web.Response(body=found.image, content_type=found.kind)

    async def alert(request: web.Request) -> web.Response:
        if request.content_type != "application/json":
            raise web.HTTPUnsupportedMediaType
        fault = on_alert(await request.read())
        if fault is None:
            return web.Response(status=202, text="taken\n")
        return web.Response(status=422, text=f"{fault}\n")

    application.router.add_post("/alerts", alert, expect_handler=_expect)
    get("/background", background)
    get("/places", places)
    get(r"/tiles/{zoom:\d{1,2}}/{x:\d{1,8}}/{y:\d{1,8}}", tile)
    get("/preview", picture)
    get("/past", earlier)
    get("/meanings", meanings)
    application.router.add_route("*", "/{path:.*}", _nothing, expect_handler=_expect)
    return application


def served(application: web.Application, wait_s: float) -> web.AppRunner:
    """Its runner, which waits so long for requests at its end. What strangers send is in no log."""
    return web.AppRunner(application, access_log=None, shutdown_timeout=wait_s, logger=_LOG)


class _Ours(logging.Filter):
    """Passes on our own faults, and not that a request could not be read."""

    def filter(self, record: logging.LogRecord) -> bool:
        return record.exc_info is None or not isinstance(record.exc_info[1], HttpProcessingError)


_LOG = logging.getLogger("distloc.ground.web")
_LOG.addFilter(_Ours())


async def _expect(_request: web.Request) -> None:
    """No request here has a body to wait for; aiohttp's own fails at what is no ASCII."""


async def _nothing(_request: web.Request) -> web.StreamResponse:
    raise web.HTTPNotFound


def _page_or(page: _Handler, landing: _Handler) -> _Handler:
    """One address for people and for programs."""

    async def answer(request: web.Request) -> web.StreamResponse:
        return await (landing if wants_json(request) else page)(request)

    return answer


def _file(path: Path) -> Callable[[web.Request], Awaitable[web.Response]]:
    body, kind = path.read_bytes(), _TYPES[path.suffix]

    async def answer(_request: web.Request) -> web.Response:
        return web.Response(body=body, content_type=kind, charset="utf-8")

    return answer
