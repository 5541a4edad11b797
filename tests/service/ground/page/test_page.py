"""The crew's page in a real browser, served by the real ground, told by real publishers."""

import io
import itertools
import time

import cv2
import msgspec
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, expect
from pyproj import Geod, Transformer

from service.publish.parts import AdviceReport
from service.publish.zenoh import ZenohPublisher
from tests.support.browser import SIZES, needs_chromium, row, watched
from tests.support.crew_ground import drone, ground
from tests.support.foul_messages import FOUL, TARGET, foul_messages
from tests.support.ground_samples import NOW_S, ellipse, report_bytes, status_bytes, vehicle_bytes
from tests.support.places import HANG_S

pytestmark = needs_chromium
LAT_DEG, LON_DEG = 47.42774, 8.60559
NAME = "<img src=x onerror=alert(1)>"


numbers = itertools.count(10)


def test_a_fire_is_shown_as_it_was_told_and_what_changes_too(
    browser: Browser, crew: tuple[ZenohPublisher, str]
) -> None:
    publisher, address = crew
    target = next(numbers)
    publisher.publish_vehicle(vehicle_bytes())
    publisher.publish_status(status_bytes(degraded=("compass",)))
    publisher.publish_report(target, report_bytes(target, state="tentative"))
    with watched(browser, address) as one:
        shown = row(one.page, target)
        expect(shown).to_contain_text("Not sure yet")
        expect(shown).to_contain_text("47° 25.664' N")
        expect(shown).to_contain_text("± 180 m × 60 m")
        publisher.publish_report(target, report_bytes(target))
        expect(shown).to_contain_text("Confirmed")
        expect(one.page.locator(f'.alert[data-fire="drone1/{target}"]')).to_have_count(1)
        expect(one.page.locator("#drones")).to_contain_text("Calibrate the compass")
        expect(one.page.locator("#link")).to_contain_text("Live")
        assert (one.complaints, one.strangers) == ([], [])


def test_the_pilot_reads_where_to_fly_next(browser: Browser, crew: tuple[ZenohPublisher, str]) -> None:
    publisher, address = crew
    target = next(numbers)
    advice = AdviceReport(kind="leg", heading_deg=40.0, length_m=400.0, seconds=40.0, half_length_m=80.0)
    publisher.publish_report(target, report_bytes(target, state="tentative", advice=advice))
    with watched(browser, f"{address}#drone1%2F{target}") as one:
        detail = one.page.locator("#detail")
        expect(detail).to_contain_text("To be surer")
        expect(detail).to_contain_text("fly 040°, 400 m (40 s), for ± 80 m")
        unsure = msgspec.structs.replace(advice, kind="arc", half_length_m=None)
        publisher.publish_report(target, report_bytes(target, state="tentative", advice=unsure))
        expect(detail).to_contain_text("begin an arc about it at 040°, 400 m (40 s)")
        expect(detail).not_to_contain_text("for ±")
        publisher.publish_report(target, report_bytes(target, advice=None))
        expect(detail).not_to_contain_text("To be surer")
        assert (one.complaints, one.strangers) == ([], [])


def red(page: Page) -> NDArray[np.bool_]:
    """Where the map, as a picture of the screen, has the colour of a confirmed fire."""
    data = page.locator("#map").screenshot()
    picture = cv2.imdecode(np.frombuffer(io.BytesIO(data).getvalue(), np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(np.abs(picture.astype(int) - np.array([0x1A, 0x20, 0xC8])).max(axis=2) < 12)


@pytest.mark.parametrize(("semi_major_m", "semi_minor_m", "azimuth_deg"), [(180.0, 60.0, 70.0), (900.0, 300.0, 110.0)])
def test_place_and_ellipse_are_where_they_belong_to_two_pixels(
    browser: Browser, semi_major_m: float, semi_minor_m: float, azimuth_deg: float
) -> None:
    """By the pixels of the screen, against pyproj's Mercator and geodesic lines."""
    shape = ellipse(semi_major_m, semi_minor_m, azimuth_deg)
    payload = report_bytes(3, ellipse95=shape, region95=ellipse(None, None, None), plume=None)
    with drone() as (publisher, endpoint), ground("--connect", endpoint) as served:
        publisher.publish_report(3, payload)
        with watched(browser, served.address) as one:
            expect(row(one.page, 3)).to_be_visible()
            expect(one.page.locator(".alert")).to_have_count(1)  # the map has got smaller by it
            one.page.evaluate("document.getElementById('legend').hidden = true")  # its symbols have the colour too
            centre = one.page.evaluate("([lat, lon]) => distloc.look(lat, lon, 150)", [LAT_DEG, LON_DEG + 0.001])
            found_y, found_x = np.nonzero(red(one.page))
    scale = 256.0 * 2.0 ** centre["zoom"] / (2.0 * np.pi * 6378137.0)  # pixels a metre of the projection
    to_mercator = Transformer.from_crs(4326, 3857, always_xy=True)

    def pixel(lon_deg: float, lat_deg: float) -> NDArray[np.float64]:
        there, middle = (
            np.array(to_mercator.transform(*one)) for one in ((lon_deg, lat_deg), (centre["lon"], centre["lat"]))
        )
        away = (there - middle) * scale
        return np.array([centre["width"] / 2 + away[0], centre["height"] / 2 - away[1]])

    fire = pixel(LON_DEG, LAT_DEG)
    away = np.stack([found_x, found_y]).T + 0.5 - fire
    symbol = away[np.hypot(*away.T) < 14.0]
    assert abs((symbol[:, 0].min() + symbol[:, 0].max()) / 2) < 2.0  # its triangle is as wide to both sides
    assert symbol[:, 1].min() == pytest.approx(-11.0, abs=3.0)
    for azimuth, length_m in ((azimuth_deg, semi_major_m), (azimuth_deg + 90.0, semi_minor_m)):
        for turn in (0.0, 180.0):
            lon_deg, lat_deg, _ = Geod(ellps="WGS84").fwd(LON_DEG, LAT_DEG, azimuth + turn, length_m)
            vertex = pixel(lon_deg, lat_deg) - fire
            assert np.hypot(*(away - vertex).T).min() < 2.0
    beyond = away @ np.array([np.sin(np.radians(azimuth_deg)), -np.cos(np.radians(azimuth_deg))])
    lon_deg, lat_deg, _ = Geod(ellps="WGS84").fwd(LON_DEG, LAT_DEG, azimuth_deg, semi_major_m)
    assert beyond.max() < float(np.hypot(*(pixel(lon_deg, lat_deg) - fire))) + 3.0


def test_two_drones_fires_that_may_be_one_say_so_and_lead_to_each_other(browser: Browser) -> None:
    with drone() as (publisher, endpoint), drone("drone2") as (other, another):
        publisher.publish_report(1, report_bytes(1))
        # without a range it is not fused
        other.publish_report(4, report_bytes(4, "drone2", lat_deg=LAT_DEG + 0.0003, range_m=None))
        with (
            ground("--connect", endpoint, "--connect", another) as served,
            watched(browser, served.address) as one,
        ):
            expect(row(one.page, 1)).to_contain_text("may be one with drone2 no. 4")
            expect(one.page.locator('.alert[data-fire="drone2/4"]')).to_contain_text("may be one with drone1 no. 1")
            row(one.page, 1).locator("button").click()
            one.page.locator("#detail .twins a").click()
            expect(one.page.locator("#detail h2")).to_have_text("drone2 no. 4")
            expect(one.page.locator("#detail .twins a")).to_have_text("drone1 no. 1")
            other.publish_report(4, report_bytes(4, "drone2", lat_deg=LAT_DEG + 0.01, at_s=NOW_S + 1.0))
            expect(one.page.locator("#detail .twins")).to_be_hidden()
            expect(row(one.page, 1)).not_to_contain_text("may be one")
            assert (one.complaints, one.strangers) == ([], [])


def test_a_fires_last_picture_stays_beside_it_though_the_camera_looks_elsewhere(browser: Browser) -> None:
    wide, narrow = (cv2.imencode(".jpg", np.full((72, n, 3), 90, np.uint8))[1].tobytes() for n in (128, 64))
    with (
        drone() as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        watched(browser, served.address) as one,
    ):
        page, image = one.page, one.page.locator("#detail figure img")

        def told(target: int, state: str, *words: str) -> None:
            publisher.publish_report(target, report_bytes(target, state=state, at_s=time.time()))
            for word in words:
                expect(row(page, target)).to_contain_text(word)

        publisher.publish_vehicle(vehicle_bytes(at_s=time.time()))  # its clock is known by it
        told(1, "confirmed", "Confirmed")
        row(page, 1).locator("button").click()
        caption = page.locator("figcaption", has_text="the last one with this fire in view")
        until_s = time.monotonic() + HANG_S
        while not caption.count():  # a slow computer may take the picture long after the report
            assert time.monotonic() < until_s
            told(1, "confirmed", "Confirmed")
            publisher.publish_preview(wide)
            expect(image).to_have_js_property("naturalWidth", 128)
        told(1, "coasting", "Out of view")
        told(2, "coasting", "Out of view")
        publisher.publish_preview(narrow)
        row(page, 2).locator("button").click()
        expect(image).to_have_js_property("naturalWidth", 64)
        expect(page.locator("figcaption")).to_contain_text("the fire was not in it")
        row(page, 1).locator("button").click()
        expect(image).to_have_js_property("naturalWidth", 128)
        assert (one.complaints, one.strangers) == ([], [])


def test_markup_and_scripts_in_every_string_of_every_message_are_only_text(browser: Browser) -> None:
    """Field by field, by the schema; then a drone whose very name is markup."""
    name = "<b onclick=alert(1)>x"
    with (
        drone() as (publisher, endpoint),
        drone(name) as (foul, another),
        ground("--connect", endpoint, "--connect", another) as served,
        watched(browser, served.address) as one,
    ):
        page = one.page
        publisher.publish_vehicle(vehicle_bytes())
        publisher.publish_report(TARGET, report_bytes(TARGET))
        row(page, TARGET).locator("button").click()
        markup = "document.querySelectorAll('b, #drones img, #fires img, #alerts img, #detail img[src=x]').length"
        for number, message in enumerate(foul_messages()):
            match message.key.split("/")[2]:
                case "status":
                    publisher.publish_status(message.payload)
                case "vehicle":
                    publisher.publish_vehicle(message.payload)
                case "targets":
                    publisher.publish_report(TARGET, message.payload)
            seen = 1000 + number  # what came before it on the way is on the screen with it
            publisher.publish_report(seen, report_bytes(seen))
            expect(row(page, seen)).to_be_visible()
            assert page.evaluate(markup) == 0, message.field
        foul.publish_report(1, report_bytes(1, name, degraded=[FOUL], aim=FOUL, time_source=FOUL))
        foul.publish_status(status_bytes(name, degraded=(FOUL,)))
        shown = page.locator("tbody tr button", has_text=f"{name} no. 1")
        shown.click()
        expect(page.locator("#detail")).to_contain_text("<img src=x onerror=alert(1)>")
        expect(page.locator("#drones")).to_contain_text("<img src=x onerror=alert(1)>")
        assert page.evaluate(markup) == 0
        assert (one.complaints, one.strangers) == ([], [])


def test_a_link_of_its_own_opens_a_fire_and_a_ground_that_ends_is_told(browser: Browser) -> None:
    with drone() as (publisher, endpoint), ground("--connect", endpoint) as served:
        publisher.publish_report(7, report_bytes(7))
        with watched(browser, f"{served.address}#drone1%2F7") as one:
            expect(one.page.locator("#detail h2")).to_have_text("drone1 no. 7")
            served.process.terminate()
            expect(one.page.locator("#link")).to_contain_text("No word from the ground")


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", ["desk", "phone"])
def test_axe_finds_nothing_that_keeps_people_out(
    browser: Browser, crew: tuple[ZenohPublisher, str], size: str, theme: str
) -> None:
    publisher, address = crew
    target = next(numbers)
    publisher.publish_vehicle(vehicle_bytes())
    publisher.publish_status(status_bytes(degraded=("compass",)))
    for offset, state in enumerate(("confirmed", "tentative", "coasting", "dismissed")):
        publisher.publish_report(target + 100 * offset, report_bytes(target + 100 * offset, state=state))
    with watched(browser, address, size, theme) as one:
        shown = row(one.page, target)
        expect(shown).to_be_visible()
        shown.locator("button").click()
        expect(one.page.locator("#detail h2")).to_be_visible()
        found = Axe().run(one.page).response["violations"]
        faults = [(fault["id"], node["html"]) for fault in found for node in fault["nodes"]]
        assert faults == []
        rights = one.page.evaluate(
            "[...document.querySelectorAll('button, #detail *, td, th')].map(one => one.getBoundingClientRect().right)"
        )
        assert max(rights) <= SIZES[size][0]  # nothing is cut off at the side
