"""The answer as files: places.geojson, places.csv, places.kml and, where there is matplotlib, map.png."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from distloc.batch.place import Located, Place
from distloc.batch.sighting import Sighting
from service.commands.locate import words
from service.commands.locate.shapes import outline
from service.common.files import write_whole
from service.publish.exchange import kml
from service.publish.exchange.features import polygon
from service.publish.exchange.rings import cut_at_antimeridian
from service.publish.parts import azimuth_deg, ellipse_report, rounded

SCHEMA = "distloc/place/1"
_DOUBT = "doubt"
_COLUMNS = (
    *("target", "state", "lat", "lon", "altitude_m", "altitude_of"),
    *("semi_major_m", "semi_minor_m", "azimuth_deg", "range_low_m", "range_high_m"),
    *("bearing_deg", "bearing95_deg", "sightings", "platforms"),
)


def write_all(
    out: Path, located: Located, sightings: Sequence[Sighting], where: Sequence[str], is_ellipsoidal: bool
) -> list[str]:
    """Write the three files into a folder that is there; their names."""
    write_whole(out / "places.geojson", _geojson(located, sightings, where, is_ellipsoidal))
    write_whole(out / "places.csv", _csv(located, is_ellipsoidal))
    write_whole(out / "places.kml", _kml(located, sightings))
    return ["places.geojson", "places.csv", "places.kml"]


def _geojson(located: Located, sightings: Sequence[Sighting], where: Sequence[str], is_ellipsoidal: bool) -> bytes:
    features: list[dict[str, Any]] = []
    for place in located.places:
        properties = _properties(place, sightings, where, is_ellipsoidal)
        point = None
        if place.lat_deg is not None and place.lon_deg is not None:
            coordinates = [round(place.lon_deg, 8), round(place.lat_deg, 8)]
            if is_ellipsoidal and place.height_m is not None:
                coordinates.append(round(place.height_m, 1))
            point = {"type": "Point", "coordinates": coordinates}
        features.append({"type": "Feature", "geometry": point, "properties": properties | {"kind": "place"}})
        for ring in outline(place, located, sightings[place.bearing.index]):
            kind = "ellipse95" if place.is_bounded else "sector"
            features.append(
                {
                    "type": "Feature",
                    "geometry": polygon(cut_at_antimeridian(ring)),
                    "properties": {"kind": kind, "target": place.target},
                }
            )
    rejected = [
        {"sighting": where[one.index], "reason": one.reason.value, "says": words.why(one, where)}
        for one in located.rejected
    ]
    whole = {"type": "FeatureCollection", "features": features, "not_used": rejected, "notes": list(located.notes)}
    return msgspec.json.format(msgspec.json.encode(whole), indent=1) + b"\n"


def _properties(
    place: Place, sightings: Sequence[Sighting], where: Sequence[str], is_ellipsoidal: bool
) -> dict[str, Any]:
    low_m, high_m = place.bearing.range95_m
    covariance = place.covariance_enu_m2
    camera = sightings[place.bearing.index]
    return {
        "schema": SCHEMA,
        "target": place.target,
        "state": state(place),
        "altitude_msl_m": None if is_ellipsoidal or place.height_m is None else rounded(place.height_m, 1),
        "altitude_ellipsoidal_m": rounded(place.height_m, 1) if is_ellipsoidal and place.height_m is not None else None,
        "covariance_enu_m2": None if covariance is None else [[rounded(v) for v in row] for row in covariance.tolist()],
        "ellipse95": None if place.ellipse95 is None else ellipse_report(place.ellipse95),
        "vertical95_m": None if place.vertical95_m is None else rounded(place.vertical95_m),
        "range95_m": [rounded(low_m), rounded(high_m)],
        "range95_parts_m": [[rounded(a), rounded(b)] for a, b in place.bearing.parts95_m],
        "bearing_deg": azimuth_deg(place.bearing.azimuth_rad, 360.0),
        "bearing95_deg": rounded(math.degrees(place.bearing.azimuth95_rad)),
        "bearing_from": [camera.lon_deg, camera.lat_deg],
        "bearing_from_platform": place.bearing.platform,
        "baseline_m": rounded(place.baseline_m),
        "parallax_deg": rounded(math.degrees(place.parallax_rad)),
        "heading_white_deg": rounded(math.degrees(place.heading_white_rad)),
        "smoke_offset_m": rounded(place.smoke_offset_m),
        "platforms": list(place.platforms),
        "against": list(place.against),
        "sightings": [where[i] for i in place.used],
        "surer": words.surer(place),
    }


def state(place: Place) -> str:
    """`located`, `rough` where the ellipse is over half the range, `bearing` where nothing bounds it, or `disputed`."""
    if place.is_disputed:
        return "disputed"
    if place.position_enu_m is None or place.ellipse95 is None:
        return "bearing"
    return "rough" if place.is_rough else "located"


def _csv(located: Located, is_ellipsoidal: bool) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for place in located.places:
        one, bearing = place.ellipse95, place.bearing
        axes = (one.semi_major_m, one.semi_minor_m, math.degrees(one.azimuth_rad)) if one else (None, None, None)
        numbers = (*axes, *bearing.range95_m, math.degrees(bearing.azimuth_rad), math.degrees(bearing.azimuth95_rad))
        writer.writerow(
            [
                place.target,
                state(place),
                *("" if value is None else f"{value:.7f}" for value in (place.lat_deg, place.lon_deg)),
                "" if place.height_m is None else f"{place.height_m:.1f}",
                "ellipsoid" if is_ellipsoidal else "sea",
                *("" if value is None or not math.isfinite(value) else f"{value:.2f}" for value in numbers),
                len(place.used),
                " ".join(place.platforms),
            ]
        )
    return text.getvalue().encode()


def _kml(located: Located, sightings: Sequence[Sighting]) -> bytes:
    marks = [kml.area_style(_DOUBT)]
    for place in located.places:
        name = f"fire {place.target}{' DISPUTED' * place.is_disputed}"
        if place.lat_deg is not None and place.lon_deg is not None and place.ellipse95 is not None:
            says = f"{words.decimal_minutes(place.lat_deg, place.lon_deg)}, 95 %: {words.ellipse(place.ellipse95)}"
            says += f"; {words.disputed(place)}" if place.is_disputed else ""
            marks.append(kml.placemark(name, kml.point(place.lat_deg, place.lon_deg), says=says))
        else:
            name = f"bearing to {place.target}: {words.bearing_words(place)}"
        for ring in outline(place, located, sightings[place.bearing.index]):
            marks.append(kml.placemark(name, kml.areas(cut_at_antimeridian(ring)), _DOUBT))
    seen = {(one.lat_deg, one.lon_deg): one.platform for one in sightings}
    if len(seen) <= 200:
        marks += [kml.placemark(platform or "camera", kml.point(lat, lon)) for (lat, lon), platform in seen.items()]
    return kml.document("distloc locate", marks)
