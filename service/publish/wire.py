"""The reports as they go over zenoh and into files: GeoJSON features with a schema, made here and nowhere else."""

import inspect
import math
from collections.abc import Sequence
from datetime import datetime, timezone
from typing import Any, Literal

import msgspec

from service.common.host import HostState
from service.common.messages import LocatedTarget, VehicleState
from service.localise.scenery import SceneryState
from service.publish.parts import (
    AdviceReport,
    EllipseReport,
    ExtentReport,
    Number,
    PlumeReport,
    ViewReport,
    advice_report,
    azimuth_deg,
    ce90_m,
    degrees,
    ellipse_report,
    extent_report,
    le90_m,
    plume_report,
    rounded,
    sigma_deg,
    view_report,
)

MAX_UTC_S = 253_402_300_799.0  # the last second that ISO 8601 writes with four digits of year


class Wire(msgspec.Struct, frozen=True, kw_only=True):
    """A JSON object; unknown keys are ignored, so that newer senders can add some."""


class Point(Wire, frozen=True, kw_only=True):
    """[lon, lat] in degrees and, where the geoid is known, the height above the ellipsoid in metres."""

    type: Literal["Point"] = "Point"
    coordinates: list[float]


class Properties(Wire, frozen=True, kw_only=True):
    """What a report says besides where; covariance is 3 x 3 in east, north, up.

    `ce90_m` is the radius of the circle, `le90_m` half of the interval of heights, that hold the target with 90 %.
    """

    schema: Literal["distloc/target/1"] = "distloc/target/1"
    vehicle: str
    target: int
    epoch: int
    seq: int
    state: Literal["tentative", "confirmed", "coasting", "dismissed"]
    time_utc: str | None
    time_source: str
    aim: str
    altitude_msl_m: Number
    covariance_enu_m2: list[list[Number]]
    ellipse95: EllipseReport
    vertical95_m: Number
    region95: EllipseReport
    extent_m: ExtentReport
    range_m: Number
    range95_m: list[Number]
    bearing_deg: Number
    existence: Number
    observations: int
    misses: int
    baseline_m: Number
    first_seen_utc: str | None
    last_seen_utc: str | None
    degraded: list[str]
    attitude: Literal["scenery", "autopilot"] = "autopilot"
    heading_sigma_deg: Number = None
    motion: Literal["fixed", "unresolved", "moving"] = "fixed"
    plume: PlumeReport | None = None
    ce90_m: Number = None
    le90_m: Number = None
    advice: AdviceReport | None = None


class Report(Wire, frozen=True, kw_only=True):
    """One target: a GeoJSON Feature. `geometry` is None where the place is not finite."""

    type: Literal["Feature"] = "Feature"
    geometry: Point | None
    properties: Properties


class VehicleReport(Wire, frozen=True, kw_only=True):
    """The camera's place and the ground that it sees: (lon, lat) corners. `height_m` is above the ellipsoid."""

    schema: Literal["distloc/vehicle/1"] = "distloc/vehicle/1"
    vehicle: str
    time_utc: str | None
    time_source: str
    lat_deg: Number
    lon_deg: Number
    altitude_msl_m: Number
    heading_deg: Number
    footprint: list[list[Number]]
    height_m: Number = None
    course_deg: Number = None
    speed_mps: Number = None
    view: ViewReport | None = None


class SceneryReport(Wire, frozen=True, kw_only=True):
    """Whose attitude is used, and what the scenery measured of the reported one's error; null where it did not.

    `error_deg` is a rotation vector about east, north and up that turns true directions into reported ones, `sigma_deg`
    one standard deviation of each. `heading_error_deg` is the reported heading minus the true one, clockwise.
    `mount_error_deg` are yaw, pitch and roll of `[camera.mount]` minus the mount's, null where they are no surer than
    `[pose_errors]`; `turned_deg` is how far apart the craft's headings were, over 360 where it circled. `landmarks` are
    `used`, `found` but not counted (yet), a `misfit`, or `unseen`, by their names.
    """

    state: Literal["scenery", "autopilot", "off"]
    error_deg: list[Number] | None = None
    heading_error_deg: Number = None
    sigma_deg: list[Number] | None = None
    corners: int = 0
    reasons: dict[str, int] = {}
    mount_error_deg: list[Number] | None = None
    mount_sigma_deg: list[Number] | None = None
    turned_deg: Number = None
    landmarks: dict[str, str] = {}


class TrackReport(Wire, frozen=True, kw_only=True):
    """What was seen, and what it lacks to be confirmed; `target` is null for a candidate, which has no reports yet."""

    target: int | None
    state: str
    sightings: int
    range95_m: list[Number]
    lacks: list[str]
    says: str


class ExplainReport(Wire, frozen=True, kw_only=True):
    """The most useful tracks; places for targets and candidates; segments that got none, in the last step and ever."""

    tracks: list[TrackReport] = []
    places: int = 0
    places_used: int = 0
    candidate_places: int = 0
    candidates: int = 0
    left_out: int = 0
    left_out_ever: int = 0


class StatusReport(Wire, frozen=True, kw_only=True):
    """The service's health."""

    schema: Literal["distloc/status/1"] = "distloc/status/1"
    vehicle: str
    time_utc: str | None
    state: Literal["ok", "degraded", "fault"]
    degraded: list[str] = []
    counters: dict[str, Any] = {}
    scenery: SceneryReport | None = None
    explain: ExplainReport | None = None
    host: HostState | None = None


class Collection(Wire, frozen=True, kw_only=True):
    """A GeoJSON FeatureCollection."""

    type: Literal["FeatureCollection"] = "FeatureCollection"
    features: list[Report]


def utc_text(time_utc_s: float) -> str | None:
    """ISO 8601 with Z and milliseconds; None where the time is not finite or before 1970."""
    if not 0.0 <= time_utc_s <= MAX_UTC_S:
        return None
    moment = datetime.fromtimestamp(round(time_utc_s * 1000.0) // 1000, timezone.utc)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{round(time_utc_s * 1000.0) % 1000:03d}Z"


def utc_s(text: str) -> float:
    """UTC in seconds of what utc_text wrote; Python 3.10's fromisoformat knows no Z."""
    return datetime.strptime(text, "%Y-%m-%dT%H:%M:%S.%f%z").timestamp()


def report_from_target(target: LocatedTarget, vehicle: str) -> Report:
    """The report of one target as it goes out."""
    estimate = target.estimate
    degraded = list(dict.fromkeys((*target.degraded, *estimate.degraded)))
    properties = Properties(
        vehicle=vehicle,
        target=estimate.id,
        epoch=target.epoch,
        seq=target.sequence,
        state=estimate.state.value,
        time_utc=utc_text(target.time_utc_s),
        time_source=target.time_source,
        aim=estimate.aim,
        altitude_msl_m=rounded(target.place.alt_msl_m),
        covariance_enu_m2=[[rounded(value) for value in row] for row in estimate.covariance_enu_m2.tolist()],
        ellipse95=ellipse_report(estimate.ellipse95),
        vertical95_m=rounded(estimate.vertical95_m),
        region95=ellipse_report(estimate.region95),
        extent_m=extent_report(estimate.extent),
        range_m=rounded(estimate.range_m),
        range95_m=[rounded(value) for value in estimate.range95_m],
        bearing_deg=azimuth_deg(estimate.bearing_rad, 360.0),
        existence=rounded(estimate.existence, 4),
        observations=estimate.observations,
        misses=estimate.misses,
        baseline_m=rounded(estimate.baseline_m),
        first_seen_utc=utc_text(target.first_seen_utc_s),
        last_seen_utc=utc_text(target.last_seen_utc_s),
        degraded=degraded,
        attitude=estimate.attitude,
        heading_sigma_deg=sigma_deg(estimate.heading_sigma_rad),
        motion=estimate.motion,
        plume=plume_report(target),
        ce90_m=ce90_m(estimate.covariance_enu_m2),
        le90_m=le90_m(estimate.covariance_enu_m2),
        advice=advice_report(target),
    )
    return Report(geometry=_point(target), properties=properties)


def report_from_vehicle(state: VehicleState, vehicle: str) -> VehicleReport:
    """The vehicle's report as it goes out."""
    velocity = state.velocity_enu_mps
    east_mps, north_mps = (None, 0.0) if velocity is None else (float(velocity[0]), float(velocity[1]))
    return VehicleReport(
        vehicle=vehicle,
        time_utc=utc_text(state.time_utc_s),
        time_source=state.time_source,
        lat_deg=rounded(state.place.lat_deg, 8),
        lon_deg=rounded(state.place.lon_deg, 8),
        altitude_msl_m=rounded(state.place.alt_msl_m),
        heading_deg=rounded(state.heading_deg),
        footprint=[[rounded(lon, 8), rounded(lat, 8)] for lon, lat in state.footprint],
        height_m=None if state.ellipsoidal_height_m is None else rounded(state.ellipsoidal_height_m),
        course_deg=None if east_mps is None else azimuth_deg(math.atan2(east_mps, north_mps), 360.0),
        speed_mps=None if east_mps is None else rounded(math.hypot(east_mps, north_mps), 2),
        view=view_report(state),
    )


def report_from_scenery(state: SceneryState) -> SceneryReport:
    """What the status says of the scenery."""
    heading_rad, mount = state.heading_error_rad, state.mount
    return SceneryReport(
        state=state.source,
        error_deg=None if state.error_rad is None else [rounded(math.degrees(one)) for one in state.error_rad],
        heading_error_deg=None if heading_rad is None else rounded(math.degrees(heading_rad)),
        sigma_deg=None if state.sigma_rad is None else [sigma_deg(float(one)) for one in state.sigma_rad],
        corners=state.corners,
        reasons=dict(sorted(state.reasons.items())),
        mount_error_deg=None if mount is None else [degrees(one) for one in mount.error_rad],
        mount_sigma_deg=None if mount is None else [degrees(one) for one in mount.sigma_rad],
        turned_deg=None if mount is None else degrees(mount.turned_rad),
        landmarks=dict(state.landmarks),
    )


def encode(report: Wire) -> bytes:
    """JSON in the fields' order: the same report gives the same bytes. Non-finite numbers become null."""
    return msgspec.json.encode(report)


def decode_report(payload: bytes) -> Report:
    """The report in `payload`; msgspec.ValidationError or DecodeError where it is none."""
    return msgspec.json.decode(payload, type=Report)


def geojson_collection(reports: Sequence[Report]) -> bytes:
    """A FeatureCollection of the reports, in their order."""
    return encode(Collection(features=list(reports)))


def report_schema() -> dict[str, Any]:
    """The JSON Schema of a report; docs/report.schema.json holds the same."""
    schema = msgspec.json.schema(Report)
    for definition in schema["$defs"].values():  # docstrings, which Python 3.13 compiles without their indentation
        definition["description"] = inspect.cleandoc(definition["description"])
    return schema


def _point(target: LocatedTarget) -> Point | None:
    lon, lat = rounded(target.place.lon_deg, 8), rounded(target.place.lat_deg, 8)
    if lon is None or lat is None:
        return None
    height = None if target.ellipsoidal_height_m is None else rounded(target.ellipsoidal_height_m)
    return Point(coordinates=[lon, lat] if height is None else [lon, lat, height])
