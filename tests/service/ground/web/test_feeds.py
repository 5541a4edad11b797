"""The feeds as programs fetch them: by real requests to the real server, and by GDAL's client of OGC API."""

import asyncio
import base64
import json
import sys
from collections.abc import Awaitable, Callable
from dataclasses import replace

import aiohttp
import pytest
from aiohttp import web

from service.common import aio
from service.ground.background.backdrop import Backdrop
from service.ground.picture.sharing import Shared
from service.ground.web.access import Access
from service.ground.web.feeds import Feeds
from service.ground.web.hub import Hub
from service.ground.web.site import served as on_sockets
from service.ground.web.site import site
from service.publish.exchange.drone import SharedDrone
from tests.support.ground_samples import NOW_S
from tests.support.places import HANG_S, ROOT
from tests.support.shared_fires import area_m2, ellipse_area_m2, shared

TOKEN = "a-token-of-ours-1234"
FIRES = [shared(3), shared(4, lat_deg=48.0, seen_s=NOW_S - 3_600.0), replace(shared(5), is_no_fire=True)]
PATHS = [
    *("/fires.geojson", "/fires.csv", "/fires.kml", "/kml", "/fires/cap?fire=drone1/3", "/?f=json", "/conformance"),
    *("/api", "/collections", "/collections/fires", "/collections/fires/items", "/collections/regions/items"),
    f"/collections/fires/items/{FIRES[0].uid}",
]
Check = Callable[[aiohttp.ClientSession, str], Awaitable[None]]


def asked(check: Check, token: str = "") -> None:
    async def run() -> None:
        feeds = Feeds(lambda: Shared(FIRES, [SharedDrone("drone1", (47.4, 8.55))]), lambda: NOW_S)
        ours = site(
            Access(token), Hub(lambda _: "{}", print), lambda _: None, lambda _: None, Backdrop(), feeds, _refused
        )
        runner = on_sockets(ours, 1.0)
        await runner.setup()
        try:
            await web.TCPSite(runner, "127.0.0.1", 0).start()
            async with aiohttp.ClientSession() as session:
                await check(session, f"http://127.0.0.1:{runner.addresses[0][1]}")
        finally:
            await runner.cleanup()

    asyncio.run(run())


def _refused(_payload: bytes) -> str:
    return "no alerts here"


async def fetched(session: aiohttp.ClientSession, url: str, **headers: str) -> tuple[int, str, bytes]:
    async with session.get(url, headers=headers, allow_redirects=False) as answer:
        return answer.status, answer.content_type, await answer.read()


@pytest.mark.parametrize("path", PATHS)
def test_a_feed_wants_the_token_in_a_cookie_a_header_or_its_address(path: str) -> None:
    joined = f"{path}{'&' if '?' in path else '?'}token="
    basic = base64.b64encode(f"qgis:{TOKEN}".encode()).decode()
    wrong = base64.b64encode(f"qgis:{TOKEN}x".encode()).decode()

    async def check(session: aiohttp.ClientSession, address: str) -> None:
        for url, headers in (
            (path, {}),
            (f"{joined}wrong", {}),
            (path, {"Authorization": f"Bearer {TOKEN}x"}),
            (path, {"Authorization": f"Basic {wrong}"}),
            (path, {"Authorization": "Basic %%%"}),
            (f"{joined}{TOKEN}", {"Origin": "http://evil.example"}),
            (f"{joined}{TOKEN}", {"Sec-Fetch-Site": "cross-site"}),
        ):
            if path == "/?f=json" and "Sec-Fetch-Site" in headers:
                continue  # a link to the page may come from anywhere
            assert (await fetched(session, address + url, **headers))[0] == 403, (url, headers)
        for url, headers in (
            (path, {"Cookie": f"distloc_token={TOKEN}"}),
            (f"{joined}{TOKEN}", {}),
            (path, {"Authorization": f"Bearer {TOKEN}"}),
            (path, {"Authorization": f"Basic {basic}"}),
        ):
            status, _, body = await fetched(session, address + url, **headers)
            assert status == 200 and body, (url, headers)

    asked(check, TOKEN)


def test_the_tokens_address_opens_the_feeds_alone() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        for path in ("/live", "/main.js", "/past", "/background"):
            assert (await fetched(session, f"{address}{path}?token={TOKEN}"))[0] == 403
        assert (await fetched(session, f"{address}/?token={TOKEN}"))[0] == 303  # the page: a cookie as before

    asked(check, TOKEN)


def test_people_get_the_page_and_programs_the_landing_page() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        browser = await fetched(session, f"{address}/", Accept="text/html,application/json;q=0.5")
        assert browser[1] == "text/html" and (await fetched(session, f"{address}/"))[1] == "text/html"
        status, kind, body = await fetched(session, f"{address}/", Accept="application/json")
        links = {one["rel"]: one["href"] for one in json.loads(body)["links"]}
        assert (status, kind) == (200, "application/json")
        assert {"self", "service-desc", "conformance", "data"} == set(links)
        for href in links.values():
            assert (await fetched(session, href))[0] == 200

    asked(check)


def test_gdal_walks_from_the_landing_page_to_the_regions() -> None:
    async def check(_session: aiohttp.ClientSession, address: str) -> None:
        command = [sys.executable, "-m", "tests.support.ogr", f"OAPIF:{address}/"]
        reader = await asyncio.create_subprocess_exec(*command, cwd=ROOT, stdout=asyncio.subprocess.PIPE)
        async with aio.timeout(HANG_S):
            read = json.loads((await reader.communicate())[0])
        assert set(read) == {"fires", "regions"}
        assert {fields["fire"] for fields, _ in read["fires"]} == {"drone1/3", "drone1/4", "drone1/5"}
        by = {(fields["fire"], fields["kind"]): area_m2(rings[0]) for fields, rings in read["regions"]}
        assert by["drone1/3", "ellipse95"] == pytest.approx(ellipse_area_m2(FIRES[0]), rel=0.02)
        assert by["drone1/3", "region95"] == pytest.approx(ellipse_area_m2(FIRES[0], "region95"), rel=0.02)

    asked(check)


def test_the_network_link_leads_back_with_the_token() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        _, _, body = await fetched(session, f"{address}/kml?token={TOKEN}")
        href = body.decode().partition("<href>")[2].partition("</href>")[0]
        assert href == f"{address}/fires.kml?token={TOKEN}"
        assert (await fetched(session, href))[0] == 200
        _, _, by_header = await fetched(session, f"{address}/kml", Authorization=f"Bearer {TOKEN}")
        assert TOKEN.encode() not in by_header

    asked(check, TOKEN)


@pytest.mark.parametrize(
    ("query", "found"),
    [
        ("", ["drone1/3", "drone1/4", "drone1/5"]),
        ("limit=1", ["drone1/3"]),
        ("bbox=8,47,9,47.9", ["drone1/3", "drone1/5"]),
        ("bbox=8,47,0,9,47.9,1000", ["drone1/3", "drone1/5"]),
        ("bbox=170,-90,-170,90", []),
        ("bbox=170,-90,9,90", ["drone1/3", "drone1/4", "drone1/5"]),
        ("datetime=2027-01-15T08:00:00Z/..", ["drone1/3", "drone1/5"]),
        ("datetime=../2027-01-15T08:00:00Z", ["drone1/4"]),
        ("f=json&limit=999999999", ["drone1/3", "drone1/4", "drone1/5"]),
    ],
)
def test_items_are_filtered(query: str, found: list[str]) -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        status, kind, body = await fetched(session, f"{address}/collections/fires/items?{query}")
        whole = json.loads(body)
        assert (status, kind) == (200, "application/geo+json")
        assert [one["properties"]["fire"] for one in whole["features"]] == found
        assert whole["numberReturned"] == len(found) <= whole["numberMatched"]

    asked(check)


@pytest.mark.parametrize(
    "query",
    [
        *("limit=0", "limit=-1", "limit=x", "limit=9" + "9" * 5_000, "bbox=1,2,3", "bbox=a,b,c,d", "bbox=nan,0,1,1"),
        *("bbox=1e9,0,1,1", "datetime=yesterday", "datetime=2027-13-01T00:00:00Z/..", "colour=red", "limit=%C2%B2"),
    ],
)
def test_a_query_that_is_none_is_a_bad_request(query: str) -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        assert (await fetched(session, f"{address}/collections/fires/items?{query}"))[0] == 400

    asked(check)


@pytest.mark.parametrize(
    "path",
    [
        *("/collections/drones", "/collections/drones/items", "/collections/fires/items/none", "/fires/cap"),
        *("/fires/cap?fire=drone9/1", "/fires.shp", "/collections/fires/items/%2e%2e%2f"),
    ],
)
def test_what_is_not_there_is_not_found(path: str) -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        assert (await fetched(session, address + path))[0] == 404

    asked(check)
