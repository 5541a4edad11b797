"""The main tasks by keyboard alone, in a real browser."""

import itertools
import re
from pathlib import Path

from playwright.sync_api import Browser, expect

from service.ground.record.recorder import Recorder
from service.publish.zenoh import ZenohPublisher
from tests.support.browser import needs_chromium, row, watched
from tests.support.crew_ground import ground
from tests.support.ground_samples import NOW_S, heard, report_bytes

pytestmark = needs_chromium
LON_DEG = 8.60559
NAME = "<img src=x onerror=alert(1)>"


numbers = itertools.count(10)


def test_by_keyboard_alone_a_fire_is_found_copied_acknowledged_named_and_judged(
    browser: Browser, crew: tuple[ZenohPublisher, str]
) -> None:
    publisher, address = crew
    target = next(numbers)
    with watched(browser, address) as one:
        page = one.page
        publisher.publish_report(target, report_bytes(target))
        expect(row(page, target)).to_be_visible()

        def press_until(selector: str, key: str = "Tab", most: int = 120) -> None:
            for _ in range(most):
                page.keyboard.press(key)
                if page.evaluate("one => document.activeElement?.matches(one)", selector):
                    return
            raise AssertionError(f"{selector} is not reached by {key}")

        press_until(f'tr[data-fire="drone1/{target}"] button')
        page.keyboard.press("Enter")
        expect(page.locator("#detail h2")).to_have_text(f"drone1 no. {target}")
        press_until('[data-copy="mgrs"]', "Shift+Tab")
        page.keyboard.press("Enter")
        expect(page.locator(".copied", has_text="Copied")).to_have_count(1)
        assert page.evaluate("() => navigator.clipboard.readText()") == "32T MT 70254 52774"
        press_until("button.seen-by")
        page.keyboard.press("Enter")
        expect(row(page, target)).to_contain_text("seen by crew")
        press_until("#fire-name")
        page.keyboard.type(NAME)
        page.keyboard.press("Enter")
        expect(page.locator("#detail h2")).to_have_text(NAME)
        press_until("button.verdict", "Shift+Tab")
        page.keyboard.press("Enter")
        expect(row(page, target)).to_contain_text("Not a fire")
        page.keyboard.press("Escape")
        expect(page.locator("#detail")).to_be_hidden()
        assert one.complaints == []


def test_by_keyboard_the_time_line_leads_back_and_home(browser: Browser, tmp_path: Path) -> None:
    with Recorder(tmp_path, 10_000_000) as recorder:
        for second in range(60):
            at_s, state = NOW_S + second, "tentative" if second < 35 else "confirmed"
            recorder.append(heard("drone1/targets/3", report_bytes(3, state=state, at_s=at_s), at_s))
    (path,) = tmp_path.glob("*.jsonl")
    with (
        ground("--replay", str(path), "--speed", "20") as served,
        watched(browser, served.address, timezone_id="UTC") as one,
    ):
        page, shown = one.page, row(one.page, 3)
        expect(shown).to_contain_text("Confirmed")
        expect(page.locator("#link")).to_contain_text(re.compile(r"08:02:(39|4\d)"))  # it has come to its end
        page.locator("#when").focus()
        page.keyboard.press("Home")
        expect(page.locator("#link")).to_contain_text("As it was at")
        expect(shown).to_contain_text("Not sure yet")
        assert (
            page.evaluate("document.activeElement.getAttribute('aria-valuetext')") == page.locator("#asof").inner_text()
        )
        for _ in range(8):  # a tenth of the way each
            page.keyboard.press("PageUp")
        expect(shown).to_contain_text("Confirmed")
        expect(page.locator("#link")).to_contain_text("As it was at")
        page.keyboard.press("Tab")
        expect(page.locator("#live")).to_be_focused()
        page.keyboard.press("Enter")
        expect(page.locator("#link")).to_contain_text("Replay of")
        expect(page.locator("#when")).to_be_focused()
        page.keyboard.press("ArrowLeft")
        expect(page.locator("#asof")).not_to_have_text("now")
        page.keyboard.press("End")
        expect(page.locator("#asof")).to_have_text("now")
        assert (one.complaints, one.strangers) == ([], [])


def test_by_keyboard_the_maps_middle_is_taken_and_measured_from(
    browser: Browser, crew: tuple[ZenohPublisher, str]
) -> None:
    publisher, address = crew
    target = next(numbers)
    publisher.publish_report(target, report_bytes(target, lat_deg=46.5))
    with watched(browser, address) as one:
        page = one.page
        expect(row(page, target)).to_be_visible()
        page.evaluate("([lat, lon]) => distloc.look(lat, lon, 150)", [46.5, LON_DEG])
        page.locator("#map").focus()
        page.keyboard.press("Enter")
        expect(page.locator("#detail h2")).to_have_text(f"drone1 no. {target}")
        page.keyboard.press("m")
        page.keyboard.press("Enter")
        expect(page.locator("#measured")).to_have_text("From 46° 30.000' N 008° 36.335' E")
        page.evaluate("([lat, lon]) => distloc.look(lat, lon, 150)", [46.5 + 1500.0 / 111_163.0, LON_DEG])
        page.locator("#map").focus()
        page.keyboard.press("Enter")
        expect(page.locator("#measured")).to_have_text("1.50 km at 000°")
        page.keyboard.press("m")
        expect(page.locator("#measured")).to_be_hidden()
        assert (one.complaints, one.strangers) == ([], [])
