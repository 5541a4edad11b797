"""The measurement of the ground: real publishers, a real ground, who watches; and what the bench says of it."""

import msgspec
import pytest

from service.commands.bench.ground.cost import GroundCost, measure_ground
from service.commands.bench.ground.screens import BROWSERS, screen
from service.commands.bench.machine import measure_machine
from service.commands.bench.result import Bench, with_limits
from service.commands.bench.run import parts_of
from service.commands.bench.service.pipeline import Latency
from service.commands.bench.table import table
from tests.support.browser import CHROMIUM, needs_chromium
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import ellipse, report_bytes
from tests.support.places import HANG_S

COST = GroundCost(
    drones=100,
    fires=10,
    reports_hz=1000.0,
    cpu=0.1,
    cpu_watched=0.14,
    seconds=600.0,
    rss_mb=120.0,
    peak_rss_mb=125.0,
    rss_mb_per_hour=3.0,
    screen="chromium",
    late_joiner_s=1.2,
    frames_hz=37.0,
    put_to_screen=Latency(120.0, 210.0, 40),
    unseen=0,
)


@pytest.mark.parametrize("names", [pytest.param(BROWSERS, marks=needs_chromium), ()])
def test_a_watcher_has_what_is_there_and_sees_what_is_told(names: tuple[str, ...]) -> None:
    with drone() as (publisher, endpoint), ground("--connect", endpoint) as served:
        for target in range(3):
            publisher.publish_report(target, report_bytes(target))
        with screen(served.address, names, HANG_S) as watcher:
            assert watcher.kind == ("chromium" if names else "websocket")
            assert watcher.late_s(3) > 0.0
            told = report_bytes(1, ellipse95=ellipse(123.0, 45.0, 0.0))
            after_s = watcher.seen_after_s("drone1/1", 123, lambda: publisher.publish_report(1, told))
            assert after_s is not None and after_s > 0.0
            frames_hz = watcher.frames_hz(47.4, 8.6, 0.5)
            assert (frames_hz or 0.0) > 0.0 if names else frames_hz is None


@pytest.mark.thorough
def test_the_ground_is_measured_with_its_drones() -> None:
    cost = measure_ground(drones=5, fires=4, seconds=4.0, rounds=5, settle_s=1.0)
    assert (cost.drones, cost.fires, cost.put_to_screen.n + cost.unseen) == (5, 4, 5)
    assert cost.reports_hz > 0.0 and 0.0 < cost.cpu < 2.0 and cost.late_joiner_s > 0.0
    assert 30.0 < cost.rss_mb <= cost.peak_rss_mb < 1000.0
    assert cost.screen == ("chromium" if CHROMIUM else "websocket")
    assert msgspec.json.decode(msgspec.json.encode(cost), type=GroundCost) == cost


def said(cost: GroundCost) -> str:
    machine = measure_machine(1_000_000, 2, big_bytes=1 << 20)
    return table(with_limits(Bench(machine=machine, limits=(), ground=cost)))


def test_the_table_says_what_it_was_watched_on_and_what_is_held() -> None:
    text = said(COST)
    for words in ("100 drones of 10 fires each, 1000 reports/s", "screen of a Chromium", "37.0 frames/s"):
        assert words in text
    assert "NOT held" not in text and "not measured" not in text
    short = msgspec.structs.replace(COST, seconds=30.0, screen="websocket", frames_hz=None, unseen=2)
    text = said(msgspec.structs.replace(short, put_to_screen=Latency(120.0, 310.0, 38)))
    for words in ("no Chromium", "2 reports were not seen", "NOT held"):
        assert words in text
    assert text.count("not measured") == 2  # a slope of half a minute tells nothing; and no frames


def test_without_the_extra_it_is_measured_only_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.commands.bench.run.is_ground_installed", lambda: False)
    assert "ground" not in parts_of(()) and parts_of(["ground"]) == ("ground",)
