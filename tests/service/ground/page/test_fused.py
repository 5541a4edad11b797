"""Fires of several drones and a tower as one on the page: listed once, marks and alerts, who is outvoted named."""

import asyncio
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from playwright.sync_api import Browser, expect

from tests.support.browser import needs_chromium, row, watched
from tests.support.crew_ground import ground
from tests.support.drone_fleet import LAT_DEG, LON_DEG, alert, post, tell, three
from tests.support.ports import free_port
from tests.support.told import live, until

pytestmark = needs_chromium


def test_a_fire_of_three_drones_is_one_row_and_who_is_outvoted_is_named(browser: Browser) -> None:
    with three() as (publishers, address), watched(browser, address) as one:
        for publisher, vehicle, bearing_deg, across_m in zip(
            publishers, ("drone1", "drone2", "drone3"), (90.0, 0.0, 225.0), (8.0, -6.0, 330.0), strict=True
        ):
            tell(publisher, vehicle, bearing_deg, across_m)
        fused = one.page.locator('tr[data-fire="fused/drone1/1"]')
        expect(fused).to_contain_text("by drone1, drone2; outvoted: drone3")
        expect(row(one.page, 1)).to_have_count(0)
        expect(row(one.page, 1, "drone2")).to_have_count(0)
        expect(row(one.page, 1, "drone3")).to_contain_text("outvoted: others put it 33")
        names = one.page.locator("#fires tbody .name")
        expect(names).to_have_text(["drone1 no. 1 +1", "drone3 no. 1 (outvoted)"])
        expect(one.page.locator('.alert[data-fire="drone3/1"]')).to_contain_text("drone3 no. 1 (outvoted)")
        assert post(address, alert(180.5)) == (202, "taken\n")
        assert post(address, alert(90.0)) == (202, "taken\n")
        expect(fused).to_contain_text("tower1")
        expect(one.page.locator("#towers")).to_contain_text("tower1: smoke at 181")
        fused.locator("button").click()
        expect(one.page.locator("#detail .members")).to_have_text("One fire, fused of drone1 no. 1, drone2 no. 1")
        expect(one.page.locator("#detail .facts")).to_contain_text("check its compass")
        row(one.page, 1, "drone3").locator("button").click()
        expect(one.page.locator("#detail h2")).to_be_in_viewport()
        expect(one.page.locator("#detail .facts")).to_contain_text("check drone3's compass")
        fused.locator("button").click()
        expect(one.page.locator("#detail h2")).to_contain_text("drone1 no. 1")  # some 200 ms after the pick
        one.page.locator("#detail .seen-by").click()
        expect(fused).to_contain_text("seen by crew")
        tell(publishers[1], "drone2", 0.0, 3_000.0)  # it looks at another fire now
        expect(row(one.page, 1, "drone2")).to_contain_text("seen by crew")
        expect(fused).to_contain_text("drone1 no. 1")  # under its name with one drone as well
        assert (one.complaints, one.strangers) == ([], [])


def test_what_becomes_fused_gives_no_second_alert(browser: Browser) -> None:
    with three() as (publishers, address), watched(browser, address) as one:
        tell(publishers[0], "drone1", 90.0)
        expect(one.page.locator('.alert[data-fire="drone1/1"]')).to_have_count(1)
        tell(publishers[1], "drone2", 0.0)
        expect(one.page.locator('.alert[data-fire="fused/drone1/1"]')).to_have_count(1)
        expect(one.page.locator(".alert")).to_have_count(1)
        one.page.locator(".alert").get_by_role("button", name="Hide").click()
        tell(publishers[2], "drone3", 225.0)
        expect(one.page.locator('tr[data-fire="fused/drone1/1"]')).to_contain_text("by drone1, drone2, drone3")
        expect(one.page.locator(".alert")).to_have_count(0)
        assert (one.complaints, one.strangers) == ([], [])


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"{", "not readable: a JSON object is expected"),
        (b"[" * 60_000, "too large"),
        (alert(float("nan")), "azimuth_deg must be a number from -360 to 360"),
        (alert(lat_deg=LON_DEG, lon_deg=LAT_DEG), "latitude and longitude swapped"),
        (alert(lat_deg=120.0, lon_deg=10.0), "latitude and longitude swapped"),
        (alert(lat_deg=200.0, lon_deg=500.0), "lat_deg must be a number from -90 to 90"),
        (alert(time_utc="2041-01-01T00:00:00Z"), "of the future"),
        (alert(time_utc="2001-01-01T00:00:00Z"), "over ten minutes old"),
        (alert(time_utc="2026-11-28T10:00:00"), "time_utc must be a time in UTC, as 2026-11-28T15:47:12Z"),
        (alert(platform="../x"), "platform must be letters, digits, '.', '_' and '-', 64 at most"),
        (alert(opening_deg=0.0), "opening_deg must be a number over 0, 120 at most"),
    ],
)
def test_an_alert_that_cannot_be_is_refused_with_its_reason(body: bytes, why: str, towered: str) -> None:
    assert post(towered, body) == (422, why + "\n")


def test_a_form_of_another_kind_and_a_get_take_no_alert(towered: str) -> None:
    assert post(towered, alert(), "text/plain")[0] == 415
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{towered}alerts")


async def known(address: str) -> None:
    async with live(address) as page:
        await until(page, lambda news: bool(news.towers))


@pytest.fixture(scope="module")
def towered() -> Iterator[str]:
    """A ground that knows where a tower stands."""
    with ground("--listen", f"tcp/127.0.0.1:{free_port()}") as served:
        assert post(served.address, alert(10.0))[0] == 202
        with ThreadPoolExecutor(1) as pool:  # Playwright has a loop in this thread
            pool.submit(asyncio.run, known(served.address)).result()
        yield served.address
