"""What a list of fires says of each, in one order and under the same names in GeoJSON, CSV and KML."""

import csv
import io
from collections.abc import Iterable

from service.publish.exchange.fire import SharedFire
from service.publish.wire import utc_text

Value = str | int | float | bool | None

COLUMNS = (
    *("fire", "uid", "crew_name", "vehicle", "state", "not_a_fire", "earlier_flight", "lat_deg", "lon_deg"),
    *("altitude_msl_m", "height_ellipsoid_m", "vertical95_m", "motion"),
    *("ellipse95_semi_major_m", "ellipse95_semi_minor_m", "ellipse95_azimuth_deg"),
    *("region95_semi_major_m", "region95_semi_minor_m", "region95_azimuth_deg"),
    *("range_m", "bearing_deg", "existence", "observations", "last_seen_utc", "told_utc", "degraded"),
    *("ce90_m", "le90_m", "advice", "acknowledged"),
    *("contributors", "undecided", "outvoted", "towers", "outvoted_by", "outvoted_away_m"),
)
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would compute


def row(fire: SharedFire) -> dict[str, Value]:
    """The values of COLUMNS; heights above the sea and above the ellipsoid each only where the report has it."""
    said, place = fire.report.properties, fire.place
    ellipse, region = said.ellipse95, said.region95
    values: tuple[Value, ...] = (
        *(fire.label, fire.uid, fire.name, fire.vehicle, said.state, fire.is_no_fire, fire.is_earlier),
        *((None, None) if place is None else place),
        *(said.altitude_msl_m, fire.height_m, said.vertical95_m, said.motion),
        *(ellipse.semi_major_m, ellipse.semi_minor_m, ellipse.azimuth_deg),
        *(region.semi_major_m, region.semi_minor_m, region.azimuth_deg),
        *(said.range_m, said.bearing_deg, said.existence, said.observations),
        *(None if one is None else utc_text(one) for one in (fire.seen_s, fire.told_s)),
        " ".join(fire.degraded),
        *(_metres(fire.ce90_m), _metres(fire.le90_m), fire.advice, fire.is_acknowledged),
        *(" ".join(getattr(fire.made_of, name, ())) for name in ("contributors", "undecided", "outvoted", "towers")),
        *(("", None) if fire.outvoted is None else (fire.outvoted.by, fire.outvoted.away_m)),
    )
    return dict(zip(COLUMNS, values, strict=True))


def table(fires: Iterable[SharedFire]) -> bytes:
    """CSV (RFC 4180) with a line of names; what is not known is empty."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for fire in fires:
        writer.writerow([_cell(one) for one in row(fire).values()])
    return text.getvalue().encode("utf-8")


def _metres(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _cell(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = str(value)
    return f"'{text}" if isinstance(value, str) and text.startswith(_FORMULA) else text
