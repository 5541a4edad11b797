"""Fires of several drones and a tower as one on the page: listed once, marks and alerts, who is outvoted named."""

import contextlib
import json
import math
import time
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from service.publish.wire import utc_text
from service.publish.zenoh import ZenohPublisher
from tests.support.browser import needs_chromium, row, watched
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import ellipse, report_bytes, vehicle_bytes
from tests.support.places import HANG_S
from tests.support.ports import free_port

pytestmark = needs_chromium
LAT_DEG, LON_DEG, RANGE_M = 47.42774, 8.60559, 2_000.0
NORTH_DEG, EAST_DEG = 1.0 / 111_180.0, 1.0 / (111_320.0 * math.cos(math.radians(LAT_DEG)))


def tell(
    publisher: ZenohPublisher,
    vehicle: str,
    bearing_deg: float,
    across_m: float = 0.0,
    target: int = 1,
    state: str = "confirmed",
) -> None:
    """A drone 2 km away that looks along a bearing; its place is so far to the right of the fire."""
    turn = math.radians(bearing_deg)
    lat_deg = LAT_DEG - across_m * math.sin(turn) * NORTH_DEG
    lon_deg = LON_DEG + across_m * math.cos(turn) * EAST_DEG
    publisher.publish_report(
        target,
        report_bytes(
            target,
            vehicle,
            state,
            time.time(),
            lat_deg,
            lon_deg,
            ellipse95=ellipse(130.0, 35.0, bearing_deg % 180.0),
            region95=ellipse(150.0, 55.0, bearing_deg % 180.0),
            range_m=RANGE_M,
            bearing_deg=bearing_deg,
            plume=None,
        ),
    )
    away_lat = lat_deg - RANGE_M * math.cos(turn) * NORTH_DEG
    away_lon = lon_deg - RANGE_M * math.sin(turn) * EAST_DEG
    publisher.publish_vehicle(
        vehicle_bytes(vehicle, time.time(), away_lat, away_lon, heading_deg=bearing_deg, footprint=[])
    )


@contextlib.contextmanager
def three() -> Iterator[tuple[list[ZenohPublisher], str]]:
    """Three drones and the address of the page that hears them."""
    with drone("drone1") as one, drone("drone2") as two, drone("drone3") as other:
        ends = [argument for _, end in (one, two, other) for argument in ("--connect", end)]
        with ground(*ends) as served:
            yield [publisher for publisher, _ in (one, two, other)], served.address


def post(address: str, body: bytes, kind: str = "application/json") -> tuple[int, str]:
    asked = urllib.request.Request(f"{address}alerts", body, {"Content-Type": kind})
    try:
        with urllib.request.urlopen(asked) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def alert(azimuth_deg: float = 180.0, **said: object) -> bytes:
    told = {
        "platform": "tower1",
        "lat_deg": LAT_DEG + 6_000.0 * NORTH_DEG,
        "lon_deg": LON_DEG,
        "azimuth_deg": azimuth_deg,
        "opening_deg": 2.0,
        "time_utc": utc_text(time.time()),
        "sigma_deg": 0.3,
    }
    return json.dumps(told | said).encode()


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
        assert post(address, alert(180.5)) == (202, "taken\n")
        assert post(address, alert(90.0)) == (202, "taken\n")
        expect(fused).to_contain_text("tower1")
        expect(one.page.locator("#towers")).to_contain_text("tower1: smoke at 181")
        fused.locator("button").click()
        expect(one.page.locator("#detail .members")).to_have_text("One fire, fused of drone1 no. 1, drone2 no. 1")
        expect(one.page.locator("#detail .facts")).to_contain_text("check its compass")
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
        (alert(time_utc="2001-01-01T00:00:00Z"), "over an hour old"),
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


@pytest.fixture(scope="module")
def towered() -> Iterator[str]:
    """A ground that knows where a tower stands."""
    with ground("--listen", f"tcp/127.0.0.1:{free_port()}") as served:
        assert post(served.address, alert(10.0))[0] == 202
        end_s = time.monotonic() + HANG_S
        while not json.load(urllib.request.urlopen(f"{served.address}past?t=now"))["towers"]:
            assert time.monotonic() < end_s
        yield served.address
