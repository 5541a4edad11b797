"""The answer as files: places.geojson, places.csv, places.kml and, where there is matplotlib, map.png."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import msgspec

from distloc.batch.place import Located, Place
from distloc.batch.sighting import Sighting
from service.commands.locate import words
from service.commands.locate.shapes import outline
from service.common.files import write_whole
from service.publish.parts import azimuth_deg, ellipse_report, rounded

SCHEMA = "distloc/place/1"
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
                    "geometry": {"type": "Polygon", "coordinates": [ring]},
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
        "baseline_m": rounded(place.baseline_m),
        "parallax_deg": rounded(math.degrees(place.parallax_rad)),
        "heading_white_deg": rounded(math.degrees(place.heading_white_rad)),
        "platforms": list(place.platforms),
        "sightings": [where[i] for i in place.used],
        "surer": words.surer(place),
    }


def state(place: Place) -> str:
    """`located`, `rough` where the ellipse is over half the range, or `bearing` where nothing bounds it."""
    if place.position_enu_m is None or place.ellipse95 is None:
        return "bearing"
    range_m = math.sqrt(place.bearing.range95_m[0] * place.bearing.range95_m[1])
    return "located" if place.ellipse95.semi_major_m < 0.5 * range_m else "rough"


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
    marks = []
    for place in located.places:
        name = escape(f"fire {place.target}")
        if place.lat_deg is not None and place.lon_deg is not None and place.ellipse95 is not None:
            says = f"{words.decimal_minutes(place.lat_deg, place.lon_deg)}, 95 %: {words.ellipse(place.ellipse95)}"
            point = f"<Point><coordinates>{place.lon_deg:.8f},{place.lat_deg:.8f}</coordinates></Point>"
            marks.append(f"<Placemark><name>{name}</name><description>{escape(says)}</description>{point}</Placemark>")
        else:
            name = escape(f"bearing to {place.target}: {words.bearing_words(place)}")
        for ring in outline(place, located, sightings[place.bearing.index]):
            corners = " ".join(f"{lon:.7f},{lat:.7f}" for lon, lat in ring)
            marks.append(
                f"<Placemark><name>{name}</name><styleUrl>#doubt</styleUrl><Polygon><outerBoundaryIs><LinearRing>"
                f"<coordinates>{corners}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
            )
    seen = {(one.lat_deg, one.lon_deg): one.platform for one in sightings}
    if len(seen) <= 200:
        for (lat, lon), platform in seen.items():
            point = f"<Point><coordinates>{lon:.8f},{lat:.8f}</coordinates></Point>"
            marks.append(f"<Placemark><name>{escape(platform or 'camera')}</name>{point}</Placemark>")
    style = (
        '<Style id="doubt"><LineStyle><color>ff2222dd</color><width>2</width></LineStyle>'
        "<PolyStyle><color>332222dd</color></PolyStyle></Style>"
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>',
        style,
        *marks,
        "</Document></kml>\n",
    ]
    return "\n".join(lines).encode("utf-8", "xmlcharrefreplace")
