"""What can't be of a report is in no form: neither in lists, nor on maps, nor in what a ground fuses."""

import csv
import io
import json
import math
from typing import Any

import pytest

from service.ground.picture.picture import Picture
from service.publish.exchange import features, kml, listing
from service.publish.exchange.judged import judged
from service.publish.exchange.rings import LARGEST_M
from tests.support.ground_samples import NOW_S, ellipse, report, report_bytes

CANNOT_BE = [
    ellipse(-5.0, 1e9, 4_000.0),
    ellipse(60.0, 180.0, 0.0),
    ellipse(5e7, 100.0, 0.0),
    ellipse(0.0, 0.0, 0.0),
    ellipse(100.0, None, 0.0),
    ellipse(100.0, 50.0, math.nan),
]


def told(**said: Any) -> Picture:
    picture = Picture()
    assert picture.hear("distloc/drone1/targets/3", report_bytes(**said), NOW_S)
    picture.compare(NOW_S)
    return picture


@pytest.mark.parametrize("one", CANNOT_BE)
def test_an_ellipse_that_cannot_be_is_in_no_form(one: Any) -> None:
    picture = told(ellipse95=one, region95=one)
    fires = picture.shared(NOW_S).fires
    (row,) = csv.DictReader(io.StringIO(listing.table(fires).decode()))
    assert {row[name] for name in row if "95_semi" in name or "95_azimuth" in name} == {""}
    assert row["lat_deg"].startswith("47.4")  # the place is told all the same
    (feature,) = json.loads(features.fires_collection(fires))["features"]
    assert feature["properties"]["ellipse95_semi_major_m"] is None
    document = kml.fires_document(fires)
    assert b"<Polygon>" not in document and b"semi_major" not in document and b"place not known well" in document
    (view,) = picture.whole(NOW_S).fires  # the page draws what it is told
    assert view.ellipse95 == view.region95 == ellipse(None, None, None)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("altitude_msl_m", 1e7),
        ("altitude_msl_m", -5_000.0),
        ("vertical95_m", -3.0),
        ("range_m", 1e12),
        ("bearing_deg", 1e300),
        ("existence", 7.0),
        ("ce90_m", 0.0),
        ("le90_m", -1.0),
    ],
)
def test_a_number_that_cannot_be_is_not_known(name: str, value: float) -> None:
    made = judged(report(**{name: value}))
    assert getattr(made.properties, name) is None
    (row,) = csv.DictReader(io.StringIO(listing.table(told(**{name: value}).shared(NOW_S).fires).decode()))
    assert row[name] == "" or name in ("ce90_m", "le90_m")  # those follow from the ellipse, too
    assert not row[name].startswith("-")


def test_a_report_that_may_be_is_the_very_same() -> None:
    whole = report(ellipse95=ellipse(LARGEST_M, 1.0, 180.0))
    assert judged(whole) is whole
