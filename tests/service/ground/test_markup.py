"""Markup and a terminal's commands in any string of any message: only text in the picture, the review, the lines."""

import re
from html.parser import HTMLParser
from typing import Any

import msgspec
import pytest

from service.ground.picture.picture import Picture
from service.ground.record.review import review
from service.ground.subscriber import line_from_report
from service.ground.watch import VehicleWatch
from tests.support.foul_messages import FOUL, TARGET, Foul, foul_messages
from tests.support.ground_samples import NOW_S, heard, report_bytes, status_bytes, vehicle_bytes

FOULS = foul_messages()
TAGS = {
    *("html", "head", "meta", "title", "style", "body", "h1", "h2", "h3", "p", "ul", "li", "br"),
    *("svg", "path", "line", "text", "polyline", "ellipse"),
    *("table", "thead", "tbody", "tr", "th", "td"),
}


def test_the_schema_was_walked() -> None:
    fields = {one.field for one in FOULS}
    assert {"Report.properties.aim", "Report.properties.degraded.*", "StatusReport.explain.tracks.*.says"} <= fields
    assert {
        "StatusReport.counters.*",
        "StatusReport.scenery.landmarks.*",
        "VehicleReport.vehicle",
        "Mark.name",
    } <= fields
    assert len(fields) > 30 and all(b"onerror" in one.payload for one in FOULS)


def strings(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value]
    parts = [*value, *value.values()] if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    return [one for part in parts for one in strings(part)]


def told(one: Foul) -> list[tuple[str, bytes]]:
    """What a good drone says, then that."""
    return [
        ("distloc/drone1/vehicle", vehicle_bytes()),
        ("distloc/drone1/status", status_bytes()),
        (f"distloc/drone1/targets/{TARGET}", report_bytes(TARGET)),
        (one.key, one.payload),
    ]


@pytest.mark.parametrize("one", FOULS, ids=[one.field for one in FOULS])
def test_in_the_picture_it_is_printable_and_in_the_review_escaped(one: Foul) -> None:
    picture = Picture()
    for key, payload in told(one):
        picture.hear(key, payload, NOW_S)
    whole = picture.whole(NOW_S)
    assert all(text.isprintable() for text in strings(msgspec.to_builtins(whole)))
    assert [fire.id for fire in whole.fires] == [f"drone1/{TARGET}"]  # and the good one is there
    tags = list[str]()
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, _: tags.append(tag)  # type: ignore[method-assign]
    page = review([heard(key.removeprefix("distloc/"), payload) for key, payload in told(one)], "Mill fire").decode()
    parser.feed(page)
    assert set(tags) <= TAGS and not re.search("[\x1b\u202e]", page)


@pytest.mark.parametrize("one", FOULS, ids=[one.field for one in FOULS])
def test_on_a_terminal_it_is_printable(one: Foul) -> None:
    watch = VehicleWatch()
    lines = [line_from_report(one.key, one.payload), line_from_report(f"distloc/{FOUL}/targets/3", one.payload)]
    lines += watch.status(one.key, one.payload) + watch.alive(f"distloc/{FOUL}/alive", True)
    assert lines and all(line.isprintable() for line in lines)
