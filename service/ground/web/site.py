"""The page's server: files, live channel, previews. Nothing is read but the page's own files."""

import logging
from collections.abc import Callable
from pathlib import Path

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from service.ground.background.backdrop import Backdrop
from service.ground.web.access import Access, wants_json
from service.ground.web.answers import Alerts, Background, Handler, Pictures, meanings
from service.ground.web.feeds import Feeds
from service.ground.web.hub import Hub

PAGE = Path(__file__).resolve().parents[1] / "page"
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
    """The application; `preview` gives a vehicle's or a fire's last JPEG, `past` the picture at a time, as JSON.
    `on_alert` takes a tower's alert, or says why not."""
    application = web.Application(middlewares=[access.guard], client_max_size=64_000)
    answers: dict[str, Handler] = {
        **_page(feeds.landing),
        **feeds.routes,
        "/live": hub.handle,
        "/meanings": meanings,
        **Pictures(preview, past).routes,
        **Background(backdrop).routes,
    }
    for path, answer in answers.items():
        application.router.add_get(path, answer, expect_handler=_expect)
    application.router.add_post("/alerts", Alerts(on_alert).take, expect_handler=_expect)
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


def _page(landing: Handler) -> dict[str, Handler]:
    """The page's own files; `landing` is for programs that ask for the root."""
    files = {
        path.relative_to(PAGE).as_posix(): _file(path) for path in sorted(PAGE.rglob("*")) if path.suffix in _TYPES
    }
    return {"/": _page_or(files.pop("index.html"), landing)} | {f"/{name}": answer for name, answer in files.items()}


def _page_or(page: Handler, landing: Handler) -> Handler:
    """One address for people and for programs."""

    async def answer(request: web.Request) -> web.StreamResponse:
        return await (landing if wants_json(request) else page)(request)

    return answer


def _file(path: Path) -> Handler:
    body, kind = path.read_bytes(), _TYPES[path.suffix]

    async def answer(_request: web.Request) -> web.Response:
        return web.Response(body=body, content_type=kind, charset="utf-8")

    return answer
