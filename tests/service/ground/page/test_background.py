"""What lies under the fires, in a real browser: the operator's own files, a server that was named, and nothing else."""

import contextlib
import http.server
import json
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Browser, expect

from tests.support.browser import needs_chromium, row, watched
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import report_bytes

pytestmark = needs_chromium
LAT_DEG, LON_DEG = 47.42774, 8.60559
FOUL = "<img src=x onerror=alert(1)>"


@contextlib.contextmanager
def tile_server(image: bytes) -> Iterator[str]:
    """Its origin; it answers everything with the image."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "image/png")
            self.end_headers()
            self.wfile.write(image)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_of_a_tile_server_that_was_named_only_images_come_and_of_another_nothing(browser: Browser) -> None:
    image = cv2.imencode(".png", np.full((256, 256, 3), 200, np.uint8))[1].tobytes()
    with tile_server(image) as origin, tile_server(image) as other, drone() as (publisher, endpoint):
        publisher.publish_report(3, report_bytes(3))
        url = f"{origin}/{{z}}/{{x}}/{{y}}.png"
        with (
            ground("--connect", endpoint, "--tiles", url, "--attribution", "the survey") as served,
            watched(browser, served.address) as one,
        ):
            expect(row(one.page, 3)).to_be_visible()
            expect(one.page.locator(".pictures .leaflet-tile-loaded").first).to_be_visible()
            expect(one.page.locator("#attribution")).to_have_text("the survey")
            assert one.strangers and all(asked.startswith(f"{origin}/") for asked in one.strangers)
            assert one.complaints == []
            load = """url => new Promise(done => {
                const image = new Image();
                image.onload = image.onerror = event => done(event.type);
                image.src = url;
            })"""
            assert [one.page.evaluate(load, f"{at}/a.png") for at in (origin, other)] == ["load", "error"]
            fetched = "url => fetch(url).then(() => 'got', () => 'refused')"
            assert one.page.evaluate(fetched, f"{origin}/a.png") == "refused"


def test_hill_shade_of_a_dem_lies_under_the_fires(browser: Browser, tmp_path: Path) -> None:
    rows, columns = np.mgrid[0:1201, 0:1201]
    (tmp_path / "N47E008.hgt").write_bytes((900 + 300 * np.sin(rows / 9) * np.sin(columns / 7)).astype(">i2").tobytes())
    with drone() as (publisher, endpoint):
        publisher.publish_report(3, report_bytes(3))
        with ground("--connect", endpoint, "--dem", str(tmp_path)) as served, watched(browser, served.address) as one:
            expect(row(one.page, 3)).to_be_visible()
            expect(one.page.locator(".shade .leaflet-tile-loaded").first).to_be_visible()
            assert (one.complaints, one.strangers) == ([], [])


def test_tiles_and_places_of_the_operators_own_lie_under_the_fires(browser: Browser, tmp_path: Path) -> None:
    green = cv2.imencode(".png", np.full((256, 256, 3), (30, 200, 90), np.uint8))[1].tobytes()
    tiles, places = tmp_path / "a.mbtiles", tmp_path / "places.geojson"
    with contextlib.closing(sqlite3.connect(tiles)) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        database.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", "png"), ("attribution", FOUL)])
        around = [
            (x, 16384 - 1 - y, green) for x in range(8574, 8595) for y in range(5733, 5754)
        ]  # zoom 14, from the south
        database.executemany("INSERT INTO tiles VALUES (14, ?, ?, ?)", around)
        database.commit()
    point = {"type": "Point", "coordinates": [LON_DEG + 0.001, LAT_DEG]}
    named = [{"type": "Feature", "geometry": point, "properties": {"name": FOUL}}]
    places.write_text(json.dumps({"type": "FeatureCollection", "features": named}))
    with drone() as (publisher, endpoint):
        publisher.publish_report(3, report_bytes(3))
        with (
            ground("--connect", endpoint, "--tiles", str(tiles), "--places", str(places)) as served,
            watched(browser, served.address) as one,
        ):
            expect(row(one.page, 3)).to_be_visible()
            expect(one.page.locator(".place-name")).to_have_text(FOUL)
            expect(one.page.locator("#attribution")).to_have_text(FOUL)
            expect(one.page.locator(".leaflet-tile-loaded").first).to_be_visible()
            data = one.page.locator("#map").screenshot()
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            is_green = np.abs(picture.astype(int) - np.array([30, 200, 90])).max(axis=2) < 8
            assert is_green.mean() > 0.5
            assert one.page.locator("img[src=x]").count() == 0
            assert (one.complaints, one.strangers) == ([], [])
