import dataclasses
import json

import msgspec
import numpy as np
import pytest

from distloc.types import Ellipse
from service.localise.mount_watch import MountState
from service.localise.scenery import NoScenery, SceneryState
from service.publish import wire
from tests.support.places import ROOT
from tests.support.wire_samples import located, vehicle

SCHEMA = ROOT / "docs" / "report.schema.json"


def test_a_report_is_the_feature_of_the_contract() -> None:
    feature = json.loads(wire.encode(wire.report_from_target(located(), "drone1")))
    said = feature["properties"]
    assert feature["type"] == "Feature"
    assert feature["geometry"] == {"type": "Point", "coordinates": [8.60559, 47.42774, 560.1]}
    assert said["schema"] == "distloc/target/1"
    assert said["ellipse95"] == {"semi_major_m": 180.0, "semi_minor_m": 60.0, "azimuth_deg": 90.0}
    assert said["covariance_enu_m2"] == [[5400.0, 0.0, 0.0], [0.0, 600.0, 0.0], [0.0, 0.0, 100.0]]
    assert (said["time_utc"], said["last_seen_utc"]) == ("2027-01-15T08:00:01.000Z", "2027-01-15T08:00:00.000Z")
    assert (said["bearing_deg"], said["altitude_msl_m"], said["range95_m"]) == (90.0, 512.346, [3900.0, 4300.0])
    assert said["degraded"] == ["link", "clock"]
    assert (said["ce90_m"], said["le90_m"]) == (123.54, 16.449)
    assert said["extent_m"] == {"width": 40.0, "width_sigma": 4.0, "height": 80.0, "height_sigma": 8.0}
    assert (said["aim"], said["motion"]) == ("base", "unresolved")
    plume = said["plume"]
    assert (plume["centre"], plume["altitude_msl_m"]) == ([8.60561, 47.42776], 572.3)
    assert (plume["lean_deg"], plume["drift_deg"], plume["extent_m"]) == (25.0, 80.0, said["extent_m"])


def test_without_the_geoid_the_height_is_left_out() -> None:
    report = wire.report_from_target(dataclasses.replace(located(), ellipsoidal_height_m=None), "drone1")
    assert report.geometry is not None
    assert report.geometry.coordinates == [8.60559, 47.42774]


def test_what_is_not_finite_is_null_everywhere() -> None:
    nan = float("nan")
    target = located(lat_deg=nan)
    estimate = dataclasses.replace(
        target.estimate,
        covariance_enu_m2=np.full((3, 3), np.inf),
        ellipse95=Ellipse(np.inf, nan, nan),
        range95_m=(0.0, np.inf),
        bearing_rad=nan,
    )
    target = dataclasses.replace(target, estimate=estimate, time_utc_s=nan, ellipsoidal_height_m=nan)
    payload = wire.encode(wire.report_from_target(target, "drone1"))
    feature = json.loads(payload, parse_constant=pytest.fail)
    assert feature["geometry"] is None
    assert feature["properties"]["time_utc"] is None
    assert feature["properties"]["range95_m"] == [0.0, None]
    assert feature["properties"]["covariance_enu_m2"] == [[None] * 3] * 3
    assert wire.decode_report(payload).properties.bearing_deg is None


def test_the_way_there_and_back() -> None:
    report = wire.report_from_target(located(), "drone1")
    payload = wire.encode(report)
    assert wire.decode_report(payload) == report
    assert wire.encode(wire.decode_report(payload)) == payload
    with pytest.raises(msgspec.ValidationError):
        wire.decode_report(payload.replace(b"distloc/target/1", b"distloc/target/9"))


def test_what_is_aimed_at_whole_has_no_plume_beside_it() -> None:
    target = located()
    whole = dataclasses.replace(target, estimate=dataclasses.replace(target.estimate, aim="centre", plume=None))
    assert wire.report_from_target(whole, "drone1").properties.plume is None


def test_a_collection_holds_the_reports() -> None:
    reports = [wire.report_from_target(located(number), "drone1") for number in (1, 2)]
    collection = json.loads(wire.geojson_collection(reports))
    assert collection["type"] == "FeatureCollection"
    assert [feature["properties"]["target"] for feature in collection["features"]] == [1, 2]


def test_vehicle_and_status() -> None:
    said = json.loads(wire.encode(wire.report_from_vehicle(vehicle(), "drone1")))
    assert (said["lat_deg"], said["heading_deg"], said["footprint"]) == (47.4, 90.0, [])
    status = wire.StatusReport(vehicle="drone1", time_utc=None, state="ok", counters={"frames": 3})
    assert json.loads(wire.encode(status))["schema"] == "distloc/status/1"


def test_the_schema_in_docs_is_that_of_the_types() -> None:
    assert json.loads(SCHEMA.read_text(encoding="utf-8")) == wire.report_schema()


@pytest.mark.parametrize(
    ("time_utc_s", "text"),
    [
        (0.0, "1970-01-01T00:00:00.000Z"),
        (1_780_000_000.25, "2026-05-28T20:26:40.250Z"),
        (-1.0, None),
        (1e18, None),
        (float("inf"), None),
    ],
)
def test_times(time_utc_s: float, text: str | None) -> None:
    assert wire.utc_text(time_utc_s) == text
    assert text is None or abs(wire.utc_s(text) - time_utc_s) < 0.001


def test_a_report_says_whose_attitude_it_was_and_how_sure_its_heading() -> None:
    estimate = dataclasses.replace(located().estimate, attitude="scenery", heading_sigma_rad=np.radians(0.25))
    said = wire.report_from_target(dataclasses.replace(located(), estimate=estimate), "drone1").properties
    assert (said.attitude, said.heading_sigma_deg) == ("scenery", 0.25)
    said = wire.report_from_target(located(), "drone1").properties  # of a filter that takes the attitude as exact
    assert (said.attitude, said.heading_sigma_deg) == ("autopilot", None)


def test_who_knows_the_old_keys_alone_reads_on_and_old_reports_are_read() -> None:
    new = json.loads(wire.encode(wire.report_from_target(located(), "drone1")))
    old = json.loads(json.dumps(new))
    added = ("attitude", "heading_sigma_deg", "motion", "plume", "ce90_m", "le90_m", "advice")
    for key in added:
        del old["properties"][key]
    said = wire.decode_report(json.dumps(old).encode()).properties
    assert (said.attitude, said.heading_sigma_deg, said.motion, said.plume) == ("autopilot", None, "fixed", None)
    required = wire.report_schema()["$defs"]["Properties"]["required"]
    assert set(added).isdisjoint(required)
    assert set(old["properties"]) - {"schema"} == set(required) - {"schema"}
    status = msgspec.json.decode(
        b'{"vehicle": "drone1", "time_utc": null, "state": "ok", "later": 1}', type=wire.StatusReport
    )
    assert status.scenery is None


def test_the_status_says_what_the_scenery_measured() -> None:
    state = SceneryState(
        "scenery", 5.0, np.radians([0.1, -0.2, 3.2]), np.radians([0.2, 0.3, 0.25]), 41, {"not_surer": 2, "gap": 1}
    )
    state = dataclasses.replace(state, landmarks={"mast": "used"})
    said = json.loads(wire.encode(wire.report_from_scenery(state)))
    assert said == {
        "state": "scenery",
        "error_deg": [0.1, -0.2, 3.2],
        "heading_error_deg": -3.2,
        "sigma_deg": [0.2, 0.3, 0.25],
        "corners": 41,
        "reasons": {"gap": 1, "not_surer": 2},
        "mount_error_deg": None,
        "mount_sigma_deg": None,
        "turned_deg": None,
        "landmarks": {"mast": "used"},
    }
    mount = MountState((None, *np.radians([-1.5, 0.25])), (None, *np.radians([0.4, 0.45])), 7.0)
    said = wire.report_from_scenery(dataclasses.replace(state, mount=mount))
    assert (said.mount_error_deg, said.mount_sigma_deg) == ([None, -1.5, 0.25], [None, 0.4, 0.45])
    assert said.turned_deg == 401.07
    assert json.loads(wire.encode(wire.report_from_scenery(NoScenery.state))) == {
        "state": "off", "error_deg": None, "heading_error_deg": None, "sigma_deg": None, "corners": 0, "reasons": {},
        "mount_error_deg": None, "mount_sigma_deg": None, "turned_deg": None,
        "landmarks": {},
    }  # fmt: skip
