"""The fires for other programs to fetch: KML with a network link, GeoJSON, CSV, CAP drafts, OGC API - Features."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from typing import ParamSpec, TypeVar
from urllib.parse import quote

from aiohttp import web

from service.ground.picture.clock import utc_s_from_text
from service.ground.picture.sharing import Shared
from service.publish.exchange import cap, features, kml, listing
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.tower import Sector, SharedTower
from service.publish.wire import utc_text

REFRESH_S = 5
MOST_ITEMS = 10_000
_CORE = "http://www.opengis.net/spec/ogcapi-features-1/1.0"
_CONFORMS = [f"{_CORE}/conf/core", f"{_CORE}/conf/geojson"]
_CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
_TITLES = {
    "fires": "Fires, each once",
    "regions": "The 95 % regions of the fires and of their smoke",
    "sectors": "Where towers see smoke",
}
_P = ParamSpec("_P")
_T = TypeVar("_T")
_Box = tuple[float, float, float, float]
_PARAMETERS = {"bbox", "datetime", "limit", "f", "token"}


class Feeds:
    """`shared` gives what there is, `now_s` the ground's time. A crew's "not a fire" is in the lists and says so."""

    def __init__(self, shared: Callable[[], Shared], now_s: Callable[[], float]) -> None:
        self._shared, self._now_s = shared, now_s
        self._making = asyncio.Lock()
        self.routes = {
            "/fires.geojson": self.geojson,
            "/fires.csv": self.csv,
            "/fires.kml": self.kml,
            "/kml": self.network_link,
            "/fires/cap": self.cap,
            "/conformance": self.conformance,
            "/api": self.api,
            "/collections": self.collections,
            "/collections/{name}": self.collection,
            "/collections/{name}/items": self.items,
            "/collections/{name}/items/{identity}": self.item,
        }

    async def geojson(self, _request: web.Request) -> web.Response:
        body = await self._made(features.fires_collection, self._shared().fires)
        return web.Response(body=body, content_type=features.GEOJSON)

    async def csv(self, _request: web.Request) -> web.Response:
        body = await self._made(listing.table, self._shared().fires)
        return web.Response(body=body, content_type="text/csv", charset="utf-8")

    async def kml(self, _request: web.Request) -> web.Response:
        fires, drones, towers = self._shared()[:3]
        return web.Response(body=await self._made(kml.fires_document, fires, drones, towers), content_type=kml.KML)

    async def network_link(self, request: web.Request) -> web.Response:
        """It leads to this very server, with the token that it was asked for with."""
        return web.Response(body=kml.network_link(self._href(request, "/fires.kml"), REFRESH_S), content_type=kml.KML)

    async def cap(self, request: web.Request) -> web.Response:
        body = cap.draft(self._fire(request.query.get("fire", "")), self._now_s())
        if body is None:
            raise web.HTTPNotFound
        return web.Response(body=body, content_type=cap.CAP)

    async def landing(self, request: web.Request) -> web.Response:
        """OGC API's root, for who asks for JSON there."""
        return _json(
            {
                "title": "distloc",
                "description": "Wildfires that drones see, and how sure their places are",
                "links": [
                    self._link(request, "/", "self", "application/json"),
                    self._link(request, "/api", "service-desc", _OPENAPI),
                    self._link(request, "/conformance", "conformance", "application/json"),
                    self._link(request, "/collections", "data", "application/json"),
                ],
            }
        )

    async def conformance(self, _request: web.Request) -> web.Response:
        return _json({"conformsTo": _CONFORMS})

    async def api(self, _request: web.Request) -> web.Response:
        paths = [path for path in self.routes if not path.startswith("/fires") and path != "/kml"]
        return web.Response(text=json.dumps(_openapi(["/", *paths])), content_type=_OPENAPI.partition(";")[0])

    async def collections(self, request: web.Request) -> web.Response:
        found = [self._described(request, name) for name in _TITLES]
        return _json({"collections": found, "links": [self._link(request, "/collections", "self", "application/json")]})

    async def collection(self, request: web.Request) -> web.Response:
        return _json(self._described(request, _name(request)))

    async def items(self, request: web.Request) -> web.Response:
        """All that match `bbox` (by the fire's place) and `datetime` (when it was seen last), `limit` at most."""
        name = _name(request)
        limit, box, span_s = _limit(request), _box(request), _span_s(request)
        found = await self._made(_features, self._shared(), name, box, span_s)
        links = [self._link(request, f"/collections/{name}/items", "self", features.GEOJSON)]
        body = features.collection(
            found[:limit],
            numberMatched=len(found),
            numberReturned=len(found[:limit]),
            timeStamp=utc_text(self._now_s()),
            links=links,
        )
        return web.Response(body=body, content_type=features.GEOJSON)

    async def item(self, request: web.Request) -> web.Response:
        name, identity = _name(request), request.match_info["identity"]
        for feature in await self._made(_features, self._shared(), name):
            if feature["id"] == identity:
                return web.Response(text=json.dumps(feature), content_type=features.GEOJSON)
        raise web.HTTPNotFound

    async def _made(self, make: Callable[_P, _T], *asked: _P.args, **named: _P.kwargs) -> _T:
        """In a thread, one at a time: 2,000 fires take over a second, in which the ground hears and shows on."""
        async with self._making:
            return await asyncio.to_thread(make, *asked, **named)

    def _fire(self, identity: str) -> SharedFire:
        """By its uid, or by `drone1/3`: then the one that came last, or the fused one that this is part of."""
        fires = self._shared().fires
        for fire in fires:
            if fire.uid == identity or (fire.label == identity and not fire.is_earlier):
                return fire
        for fire in fires:
            if identity in fire.labels and not fire.is_earlier:
                return fire
        raise web.HTTPNotFound

    def _described(self, request: web.Request, name: str) -> dict[str, object]:
        items = self._link(request, f"/collections/{name}/items", "items", features.GEOJSON)
        own = self._link(request, f"/collections/{name}", "self", "application/json")
        return {"id": name, "title": _TITLES[name], "itemType": "feature", "crs": [_CRS84], "links": [own, items]}

    def _link(self, request: web.Request, path: str, relation: str, kind: str) -> dict[str, str]:
        return {"href": self._href(request, path), "rel": relation, "type": kind}

    @staticmethod
    def _href(request: web.Request, path: str) -> str:
        token = request.query.get("token")
        return f"{request.scheme}://{request.host}{path}" + (f"?token={quote(token)}" if token else "")


_OPENAPI = "application/vnd.oai.openapi+json;version=3.0"


def _openapi(paths: list[str]) -> dict[str, object]:
    """As much of a description as OGC API - Features' landing page has to lead to."""

    def parameter(name: str, where: str) -> dict[str, object]:
        return {"name": name, "in": where, "required": where == "path", "schema": {"type": "string"}}

    described = {}
    for path in paths:
        inside = [part.strip("{}") for part in path.split("/") if part.startswith("{")]
        parameters = [parameter(one, "path") for one in inside]
        if path.endswith("/items"):
            parameters += [parameter(one, "query") for one in ("bbox", "datetime", "limit")]
        described[path] = {"get": {"parameters": parameters, "responses": {"200": {"description": "JSON"}}}}
    return {"openapi": "3.0.3", "info": {"title": "distloc", "version": "1"}, "paths": described}


def _json(said: object) -> web.Response:
    return web.Response(text=json.dumps(said), content_type="application/json")


def _name(request: web.Request) -> str:
    name = request.match_info["name"]
    if name not in _TITLES:
        raise web.HTTPNotFound
    return name


def _features(
    shared: Shared, name: str, box: _Box | None = None, span_s: tuple[float, float] | None = None
) -> list[dict[str, object]]:
    if name == "sectors":
        towers = (replace(one, sectors=_held(one, span_s)) for one in shared.towers if _is_in(one.place, box))
        return [feature for one in towers for feature in features.sector_features(one)]
    fires = (one for one in shared.fires if _is_in(one.place, box) and _is_within(one.seen_s, span_s))
    if name == "fires":
        return [features.point_feature(one) for one in fires]
    return [feature for one in fires for feature in features.region_features(one)]


def _held(tower: SharedTower, span_s: tuple[float, float] | None) -> tuple[Sector, ...]:
    return tuple(one for one in tower.sectors if _is_within(one.told_s, span_s))


def _limit(request: web.Request) -> int:
    unknown = set(request.query) - _PARAMETERS
    text = request.query.get("limit", str(MOST_ITEMS))
    if unknown or not text.isascii() or not text.isdigit() or len(text) > 9 or int(text) < 1:
        raise web.HTTPBadRequest
    return min(int(text), MOST_ITEMS)


def _box(request: web.Request) -> _Box | None:
    """West, south, east, north; west may be east of east, across the antimeridian."""
    if "bbox" not in request.query:
        return None
    try:
        numbers = [float(one) for one in request.query["bbox"].split(",")]
    except ValueError as error:
        raise web.HTTPBadRequest from error
    if len(numbers) == 6:
        numbers = [numbers[0], numbers[1], numbers[3], numbers[4]]
    if len(numbers) != 4 or not all(abs(one) <= 360.0 for one in numbers):
        raise web.HTTPBadRequest
    west, south, east, north = numbers
    return west, south, east, north


def _is_in(place: tuple[float, float] | None, box: _Box | None) -> bool:
    if box is None:
        return True
    if place is None:
        return False
    (lat, lon), (west, south, east, north) = place, box
    is_between = west <= lon <= east if west <= east else lon >= west or lon <= east
    return south <= lat <= north and is_between


def _span_s(request: web.Request) -> tuple[float, float] | None:
    """A time or an interval of RFC 3339, an end of which may be open (`..` or empty)."""
    text = request.query.get("datetime")
    if text is None:
        return None
    begin, slash, end = text.partition("/")
    ends = (begin, end if slash else begin)
    found = [utc_s_from_text(one) for one in ends]
    if any(one not in ("", "..") and time_s is None for one, time_s in zip(ends, found, strict=True)):
        raise web.HTTPBadRequest
    return found[0] or float("-inf"), found[1] or float("inf")


def _is_within(time_s: float | None, span_s: tuple[float, float] | None) -> bool:
    return span_s is None or (time_s is not None and span_s[0] <= time_s <= span_s[1])
