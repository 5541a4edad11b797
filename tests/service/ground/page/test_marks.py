"""What the crew said of a fire: who said it, and when."""

import re
import socket
import time

import msgspec
import zenoh
from playwright.sync_api import Browser, expect

from service.config.sections import ZenohConfig
from service.ground.picture.clock import utc_s_from_text
from service.ground.picture.marks import Mark, name_of
from service.publish.wire import decode_report
from service.publish.zenoh import zenoh_config
from tests.support.browser import needs_chromium, row, watched
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import report_bytes

pytestmark = needs_chromium


def test_who_said_not_a_fire_and_when_is_beside_it_and_a_clock_ahead_is_none(browser: Browser) -> None:
    report = report_bytes(1)
    first_s = utc_s_from_text(decode_report(report).properties.first_seen_utc)

    def said(ahead_s: float, ground: str) -> bytes:
        at_s = time.time() + ahead_s
        mark = Mark(vehicle="drone1", target=1, time_s=at_s, verdict="not_a_fire", ground=ground, first_drone_s=first_s)
        return msgspec.json.encode(mark)

    with (
        drone() as (publisher, endpoint),
        ground("--connect", endpoint) as served,
        zenoh.open(zenoh_config(ZenohConfig(mode="client", connect=(endpoint,)))) as other,
        watched(browser, served.address) as one,
    ):
        publisher.publish_report(1, report)
        one.page.locator('tr[data-fire="drone1/1"] button').click()
        line = one.page.locator("#detail .said")
        expect(line).to_be_hidden()
        other.put("distloc/drone1/marks/1", said(-7_230.0, "north-1"))
        expect(line).to_have_text(re.compile(r"Not a fire, as was said on north-1 2 h 0 min ago, at \d\d:\d\d:\d\d"))
        other.put("distloc/drone1/marks/1", said(82_800.0, "south"))
        ahead = "at a time that is not known: a ground's clock is ahead"
        expect(line).to_have_text(f"Not a fire, as was said on south {ahead}")
        one.page.locator("button.verdict").click()  # it holds, though that clock is ahead
        expect(row(one.page, 1)).to_contain_text("Confirmed")
        expect(line).to_have_text(f"Marked on {name_of(socket.gethostname())} {ahead}")
        assert one.complaints == []
