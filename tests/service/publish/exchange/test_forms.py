"""KML, GeoJSON, CSV and CAP: read by GDAL, by Python's csv and by the rules of their standards."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from service.publish.exchange import cap, features, kml, listing
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import MadeOf, Outvoted, SharedFire
from service.publish.exchange.tak import cot
from service.publish.exchange.tak.board import Board
from service.publish.exchange.tower import Sector, SharedTower
from service.publish.parts import AdviceReport
from tests.support import ogr
from tests.support.ground_samples import NOW_S, ellipse
from tests.support.shared_fires import area_m2, drawn, ellipse_area_m2, shared

OVER_180 = shared(5, lat_deg=-17.0, lon_deg=179.9995, region95=ellipse(400.0, 300.0, 20.0))
FOUL = replace(shared(6), name="=cmd|'x'!A1 <b>&]]>\x00\n\"")
ADVICE = AdviceReport(kind="leg", heading_deg=40.2, length_m=400.0, seconds=50.0, half_length_m=80.0)
TOWER = SharedTower("tower1", (47.48, 8.6), (Sector(181.0, 4.0, NOW_S),))
FUSED = replace(
    shared(9, ce90_m=41.0, le90_m=12.5, advice=ADVICE),
    made_of=MadeOf(("drone1/9", "drone2/4"), ("drone3/1",), ("drone4/2",), ("tower1",)),
    is_acknowledged=True,
)
DRONE = SharedDrone("drone1", (47.4, 8.55), altitude_msl_m=512.0)


@pytest.mark.parametrize("form", ["kml", "geojson"])
@pytest.mark.parametrize("fire", [shared(), OVER_180, shared(7, ellipse95=ellipse(15_000.0, 800.0, 175.0))])
def test_gdal_reads_the_regions_with_the_reports_area(form: str, fire: SharedFire, tmp_path: Path) -> None:
    path = tmp_path / f"fires.{form}"
    path.write_bytes(kml.fires_document([fire]) if form == "kml" else features.fires_collection([fire]))
    point, first, second = ogr.features(str(path))
    assert fire.place is not None and point.point == pytest.approx((fire.place[1], fire.place[0]), abs=1e-7)
    for read, kind in ((first, "ellipse95"), (second, "region95")):
        area = sum(area_m2(ring) for ring in read.rings)
        assert area == pytest.approx(ellipse_area_m2(fire, kind), rel=0.02)
        assert all(area_m2(ring) > 0.0 and (ring[0] == ring[-1]).all() for ring in read.rings)
        assert all(abs(ring[:, 0]).max() <= 180.0 for ring in read.rings)
        assert len(read.rings) == (2 if fire is OVER_180 else 1)


def test_gdal_reads_the_fires_values_and_the_drone(tmp_path: Path) -> None:
    path = tmp_path / "fires.kml"
    path.write_bytes(kml.fires_document([shared(), FOUL], [DRONE]))
    marks = ogr.features(str(path))
    assert marks[0].fields["Name"] == "Fire drone1/3 +-180x60m" and marks[0].fields["state"] == "confirmed"
    assert float(str(marks[0].fields["ellipse95_semi_major_m"])) == 180.0
    assert str(marks[3].fields["Name"]).startswith("=cmd|'x'!A1 <b>&]]>\\x00")
    assert marks[-1].fields["Name"] == "drone1" and marks[-1].point == pytest.approx((8.55, 47.4))
    text = path.read_text()
    assert text.count("<altitudeMode>absolute</altitudeMode>") == 1 and ",512.0<" in text
    assert text.count("<altitudeMode>clampToGround</altitudeMode>") == 4


def test_geojson_by_its_rules() -> None:
    whole = json.loads(features.fires_collection([shared(), OVER_180, FOUL]))
    assert whole["type"] == "FeatureCollection" and len(whole["features"]) == 9
    assert len({one["id"] for one in whole["features"]}) == 9
    assert whole["features"][0]["geometry"]["coordinates"] == [8.60559, 47.42774, 560.1]
    assert whole["features"][4]["geometry"]["type"] == "MultiPolygon"
    assert list(whole["features"][0]["properties"]) == list(listing.COLUMNS)


def test_a_fire_without_a_place_is_in_the_lists_with_null_and_not_in_kml() -> None:
    import msgspec

    fire = shared()
    lost = replace(fire, report=msgspec.structs.replace(fire.report, geometry=None), seen_s=None)
    (feature,) = json.loads(features.fires_collection([lost]))["features"]
    assert feature["geometry"] is None and feature["properties"]["lat_deg"] is None
    assert b"Placemark" not in kml.fires_document([lost])
    assert cap.draft(lost, NOW_S) is None


def test_csv_is_read_back_and_starts_no_formula() -> None:
    rows = list(csv.DictReader(io.StringIO(listing.table([shared(), FOUL, OVER_180]).decode())))
    assert [one["fire"] for one in rows] == ["drone1/3", "drone1/6", "drone1/5"]
    assert float(rows[0]["lat_deg"]) == 47.42774 and rows[0]["not_a_fire"] == "false"
    assert float(rows[2]["lat_deg"]) == -17.0  # a number may be negative
    assert rows[1]["crew_name"].startswith("'=cmd")


def test_a_withdrawn_fire_has_no_region_on_the_map_and_says_so_in_the_lists() -> None:
    gone = replace(shared(), is_no_fire=True)
    text = kml.fires_document([gone]).decode()
    assert "#gone" in text and "<Polygon>" not in text and "not a fire, says the crew" in text
    assert listing.row(gone)["not_a_fire"] is True


def test_a_report_of_impossible_numbers_breaks_no_form() -> None:
    wild = {"range_m": 1e308, "altitude_msl_m": -1e308, "vertical95_m": 1e308, "existence": 1e308, "bearing_deg": 1e308}
    names = {"degraded": ["x" * 10_000] * 1_000, "aim": "\x00" * 1_000}
    for time_s in (-1e12, 0.0, 1e18, float("inf")):
        fire = replace(shared(8, **wild, **names), told_s=time_s, seen_s=time_s)
        assert len(kml.fires_document([fire])) < 20_000 and len(listing.table([fire])) < 10_000
        assert json.loads(features.fires_collection([fire]))
        for event in (cot.fire_event(fire, NOW_S, 60.0), cot.region_event(fire, NOW_S, 60.0)):
            assert event is not None and drawn(event) and len(event) < 5_000
        assert cap.draft(fire, NOW_S)
        board = Board(4, 1, True)
        board.tell_fire(fire)
        assert len(board.due(NOW_S, 8)) <= 2


def test_a_network_link_refreshes_and_moves_no_view() -> None:
    text = kml.network_link("http://127.0.0.1:8080/fires.kml?token=a&b", 5).decode()
    root = ElementTree.fromstring(text)
    names = {"k": "http://www.opengis.net/kml/2.2"}
    assert root.findtext(".//k:Link/k:href", namespaces=names) == "http://127.0.0.1:8080/fires.kml?token=a&b"
    assert root.findtext(".//k:refreshInterval", namespaces=names) == "5"
    assert root.findtext(".//k:flyToView", namespaces=names) == "0"


def test_a_cap_draft_is_a_draft_in_the_order_of_its_schema() -> None:
    body = cap.draft(shared(), NOW_S)
    assert body is not None
    root = ElementTree.fromstring(body)
    names = {"c": "urn:oasis:names:tc:emergency:cap:1.2"}
    assert [one.tag.rpartition("}")[2] for one in root] == [
        *("identifier", "sender", "sent", "status", "msgType", "scope", "addresses", "note", "info")
    ]
    assert root.findtext("c:status", namespaces=names) == "Draft"
    assert root.findtext("c:sent", namespaces=names) == "2027-01-15T08:01:40-00:00"
    polygon = root.findtext(".//c:polygon", namespaces=names) or ""
    ring = [tuple(map(float, one.split(",")))[::-1] for one in polygon.split()]
    assert ring[0] == ring[-1] and area_m2(ring) == pytest.approx(ellipse_area_m2(shared()), rel=0.02)  # type: ignore[arg-type]
    assert root.findtext(".//c:certainty", namespaces=names) == "Likely"
    unsure = cap.draft(shared(state="tentative"), NOW_S) or b""
    assert b"<certainty>Possible</certainty>" in unsure


def test_each_form_says_who_tells_of_a_fire_how_sure_it_is_and_what_would_make_it_surer(tmp_path: Path) -> None:
    row = listing.row(FUSED)
    assert (row["ce90_m"], row["le90_m"], row["acknowledged"]) == (41.0, 12.5, True)
    assert row["advice"] == "fly 040 400 m for +-80 m"
    assert [row[name] for name in ("contributors", "undecided", "outvoted", "towers", "outvoted_by")] == [
        *("drone1/9 drone2/4", "drone3/1", "drone4/2", "tower1", "")
    ]
    path = tmp_path / "fires.kml"
    path.write_bytes(kml.fires_document([FUSED], towers=[TOWER]))
    mark, *_, craft, wedge = ogr.features(str(path))
    said = str(mark.fields["description"])
    assert mark.fields["Name"] == "Fire drone1/9 +2 +-180x60m"
    assert "one fire of drone1/9, drone2/4, tower1" in said and "outvoted: drone4/2" in said
    assert "to be surer: fly 040 400 m for +-80 m (drone1)" in said and "seen by the crew" in said
    assert craft.fields["Name"] == "tower1" and area_m2(wedge.rings[0]) == pytest.approx(5.585e7, rel=0.01)
    body = cap.draft(FUSED, NOW_S) or b""
    assert b"perhaps also drone3/1, not counted" in body
    others = replace(shared(3), outvoted=Outvoted("drone2/4", 331.7))
    assert others.title == "Fire drone1/3 outvoted +-180x60m"
    assert "outvoted: others put it 332 m away, at drone2/4" in others.says


def test_errors_are_as_told_and_by_the_ellipse_where_they_are_not_or_cannot_be() -> None:
    by_ellipse = listing.row(shared(ce90_m=None, le90_m=None))
    away_m = np.hypot(*np.random.default_rng(4).standard_normal((2, 200_000)) * [[180.0 / 2.4477], [60.0 / 2.4477]])
    assert np.mean(away_m <= by_ellipse["ce90_m"]) == pytest.approx(0.9, abs=0.005)
    assert by_ellipse["le90_m"] == pytest.approx(19.6 / 1.96 * 1.645, rel=0.01)
    for odd in (0.0, -5.0, 1e308):
        assert listing.row(shared(ce90_m=odd, le90_m=odd))["ce90_m"] == by_ellipse["ce90_m"]
    assert listing.row(shared(ellipse95=ellipse(None, None, None), ce90_m=3.0))["ce90_m"] is None


def test_a_thousand_contributors_make_no_event_that_is_too_large() -> None:
    many = tuple(f"drone{n}/1" for n in range(1_000))
    crowd = replace(shared(9), made_of=MadeOf(many, many, many, many))
    event = cot.fire_event(crowd, NOW_S, 60.0)
    assert event is not None and len(event) < 5_000 and len(kml.fires_document([crowd])) < 60_000
