"""What a page says while drones misbehave: floods, a clock that is off, two of one name, a disk that is full."""

import contextlib
import itertools
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from playwright.sync_api import Browser, expect

from service.config.sections import ZenohConfig
from service.publish.wire import utc_text
from service.publish.zenoh import zenoh_config
from tests.support.browser import chromium, needs_chromium, row, watched
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import report_bytes, status_bytes, vehicle_bytes
from tests.support.places import HANG_S

pytestmark = needs_chromium
HANG_MS = HANG_S * 1000.0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as one:
        yield one


@contextlib.contextmanager
def sender(endpoint: str) -> Iterator[zenoh.Session]:
    """Anybody who was let in."""
    with zenoh.open(zenoh_config(ZenohConfig(mode="client", connect=(endpoint,)))) as session:
        yield session


def test_a_flood_of_one_drone_is_counted_as_its_own_and_the_others_are_shown(browser: Browser) -> None:
    flood = [(f"distloc/bad/targets/{number}", report_bytes(number, "bad")) for number in range(200)]
    flood += [("distloc/bad/status", b"["), ("distloc/bad/vehicle", b"\xff")]
    with (
        drone("good") as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        sender(endpoint) as bad,
        watched(browser, served.address) as one,
    ):
        line = one.page.locator("#drones li", has_text="bad")
        for key, payload in itertools.islice(itertools.cycle(flood), 10_000):
            bad.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        publisher.publish_report(1, report_bytes(1, "good"))
        expect(one.page.locator('tr[data-fire="good/1"]')).to_contain_text("Confirmed", timeout=HANG_MS)
        expect(line).to_contain_text(re.compile(r"\d+ messages were refused: more than can be read"), timeout=HANG_MS)
        end_s = time.monotonic() + HANG_S
        while not re.search(r"refused: .*not readable", line.inner_text()) and time.monotonic() < end_s:
            bad.put(*flood[-1])  # a slow computer may have read none of the flood
            one.page.wait_for_timeout(150)
        expect(line).to_contain_text(re.compile(r"refused: .*not readable"))
        expect(one.page.locator("#drones li", has_text="good")).not_to_contain_text("refused")
        expect(one.page.locator("#link")).to_contain_text("Live")
        assert (one.complaints, one.strangers) == ([], [])


def test_a_clock_an_hour_off_and_two_drones_of_one_name_are_said(browser: Browser) -> None:
    with (
        drone("twin") as (_, endpoint),
        ground("--connect", endpoint) as served,
        sender(endpoint) as first,
        sender(endpoint) as second,
        watched(browser, served.address) as one,
    ):
        line = one.page.locator("#drones li", has_text="twin")
        end_s = time.monotonic() + HANG_S
        for session in itertools.cycle((first, second)):
            session.put("distloc/twin/status", status_bytes("twin", time.time() - 3600.0))
            session.put("distloc/twin/vehicle", vehicle_bytes("twin", time.time() - 3600.0))
            one.page.wait_for_timeout(150)  # two in one look of the ground are one
            if "Two drones call themselves so" in "".join(line.all_inner_texts()) or time.monotonic() > end_s:
                break
        expect(line).to_contain_text("Two drones call themselves so")
        expect(line).to_contain_text("Its clock is 1 h 0 min behind")
        assert (one.complaints, one.strangers) == ([], [])


def test_in_the_past_a_new_fire_gives_its_alert_and_live_leads_back_without_a_link(browser: Browser) -> None:
    with (
        drone() as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        watched(browser, served.address, timezone_id="UTC") as one,
    ):
        page = one.page
        publisher.publish_report(1, report_bytes(1, state="tentative"))
        expect(row(page, 1)).to_be_visible()
        page.locator("#when").focus()
        page.keyboard.press("Home")
        expect(page.locator("#link")).to_contain_text("As it was at")
        publisher.publish_report(2, report_bytes(2))
        expect(page.locator(".alert")).to_contain_text("drone1 no. 2")
        expect(page.locator("#link")).to_contain_text("As it was at")
        page.context.set_offline(True)
        page.locator("#when").press("ArrowRight")  # cannot be asked for: what is shown stays as it is said to be
        expect(page.locator("#link")).to_contain_text("As it was at")
        page.locator("#live").click()
        expect(page.locator("#asof")).to_have_text("now")
        expect(row(page, 2)).to_contain_text("Confirmed")
        page.context.set_offline(False)
        publisher.publish_report(3, report_bytes(3))
        expect(row(page, 3)).to_contain_text("Confirmed")
        expect(page.locator("#link")).to_contain_text("Live")
        page.locator("#when").press("Home")
        expect(page.locator("#link")).to_contain_text("As it was at")
        page.locator(".alert a", has_text="no. 3").click()
        expect(page.locator("#asof")).to_have_text("now")
        expect(page.locator("#detail h2")).to_have_text("drone1 no. 3")
        assert [said for said in one.complaints if "ERR_INTERNET_DISCONNECTED" not in said] == []


def test_a_full_disk_is_said_and_the_picture_goes_on(browser: Browser, tmp_path: Path) -> None:
    for day in (0, 86_400):
        name = time.strftime("ground-%Y-%m-%d.jsonl", time.gmtime(time.time() + day))
        (tmp_path / name).symlink_to("/dev/full")
    with drone() as (publisher, endpoint), ground("--connect", endpoint, "--record", str(tmp_path)) as served:
        publisher.publish_report(1, report_bytes(1, state="tentative"))
        with watched(browser, served.address) as one:
            expect(one.page.locator("#recorded")).to_have_text("Not recorded: No space left on device", timeout=HANG_MS)
            publisher.publish_report(1, report_bytes(1))
            expect(one.page.locator('tr[data-fire="drone1/1"]')).to_contain_text("Confirmed", timeout=HANG_MS)
            assert (one.complaints, one.strangers) == ([], [])


def test_a_link_that_is_slow_is_said_and_makes_no_fire_fresh(browser: Browser) -> None:
    with (
        drone() as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        watched(browser, served.address) as one,
    ):
        line = one.page.locator("#drones li", has_text="drone1")
        late_s = time.time() - 100.0
        publisher.publish_status(status_bytes(at_s=late_s))
        publisher.publish_report(1, report_bytes(1, at_s=late_s, first_seen_utc=utc_text(late_s - 20.0)))
        expect(line).to_contain_text(re.compile("Its messages come [12] min late, or its clock is that far behind"))
        expect(one.page.locator('tr[data-fire="drone1/1"] .seen')).to_contain_text(re.compile(r"\d+ min ago"))
        assert (one.complaints, one.strangers) == ([], [])


def test_a_number_that_the_next_flight_uses_again_is_a_new_alert_and_not_seen_by_crew(browser: Browser) -> None:
    with (
        drone() as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        watched(browser, served.address) as one,
    ):
        page, now_s = one.page, time.time()
        publisher.publish_report(1, report_bytes(1, at_s=now_s, first_seen_utc=utc_text(now_s - 900.0)))
        page.locator(".alert button", has_text="Acknowledge").click()
        first = page.locator('tr[data-fire="drone1/1"]')
        expect(first).to_contain_text("seen by crew", timeout=HANG_MS)
        said = {"at_s": now_s + 1.0, "lat_deg": 47.7, "first_seen_utc": utc_text(now_s - 10.0)}
        publisher.publish_report(1, report_bytes(1, **said))
        expect(page.locator(".alert")).to_contain_text("47° 42.000'", timeout=HANG_MS)
        expect(first).to_contain_text("(earlier)")
        page.locator(".alert button", has_text="Acknowledge").click()
        expect(page.locator("tr", has_text="seen by crew")).to_have_count(2)
        assert (one.complaints, one.strangers) == ([], [])
