"""Rows as sightings: what each says of place, direction and errors, and what of the whole table looks wrong."""

import math
from dataclasses import dataclass, field, replace

from distloc.batch.sighting import Sighting
from distloc.types import PoseErrors
from service.config.sections import Config
from service.recordings.sightings.aim import aim_of, has_elevation
from service.recordings.sightings.columns import (
    COLUMNS,
    EDGES,
    TEXTS,
    RowError,
    UnitError,
    numbers_of,
    stamp_of,
    texts_of,
    unknown_columns,
)
from service.recordings.sightings.reading import Record, SightingsError, Table
from service.recordings.sightings.suspects import far_apart, looks_like_radians, places_look_like_radians

_LEAST_BOXES = 3
BOX_SMOKE_M = 200.0  # from its fire at least, where a detector's box is about it
_MARKS = frozenset(
    name
    for column in ("u_px", "v_px", "azimuth_deg", "bearing_deg", *EDGES)
    for name in (column, *(also for also, _ in COLUMNS[column].also))
) | {"box", *TEXTS["box"]}
_ERROR_KEYS = ("heading_bias_deg", "tilt_bias_deg", "attitude_white_deg")


@dataclass(slots=True)
class Sightings:
    """What a table says: the sightings, where each stands (`where`), a line for each row that can't be used (`faults`).

    `notes` has what was taken for granted. Heights are all over the sea or, with `is_ellipsoidal`, over the ellipsoid.
    """

    sightings: list[Sighting] = field(default_factory=list)
    where: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    is_ellipsoidal: bool = False


@dataclass(slots=True)
class _Row:
    """One row's numbers and texts."""

    record: Record
    numbers: dict[str, float]
    texts: dict[str, str]


def sightings_of(
    tables: list[Table],
    config: Config | None,
    geoid_m: float | None,
    home: tuple[float, float] | None,
    also: frozenset[str] = frozenset(),
    smoke_offset_m: float | None = None,
) -> Sightings:
    """All rows that can be used; SightingsError where none can.

    `geoid_m` is the geoid's height over the ellipsoid, `home` a latitude and longitude near the cameras, `also` are
    columns that somebody else reads, `smoke_offset_m` is how far smoke is from its fire in rows that don't say; None:
    200 m where a row is a box, 0 where it is a mark.
    """
    found = Sightings()
    for table in tables:
        unknown = unknown_columns(table.columns, also)
        if unknown:
            found.notes.append(f"{table.path.name}: columns not used: {', '.join(unknown)}")
    rows = [row for table in tables for row in _rows(table, found)]
    rows = _on_one_datum(rows, geoid_m, found)
    for wrong, line in far_apart([(row.numbers["lat"], row.numbers["lon"]) for row in rows], home).items():
        found.faults.append(f"{rows[wrong].record.where}: {line}")
        rows[wrong].numbers.clear()
    rows = [row for row in rows if row.numbers]
    if line := places_look_like_radians([(row.numbers["lat"], row.numbers["lon"]) for row in rows]):
        found.notes.append(line)
    for name in ("azimuth_deg", "bearing_deg", "yaw_deg"):
        if line := looks_like_radians([row.numbers for row in rows], name):
            found.notes.append(line)
    _tell_boxes(rows, found)
    zoneless = 0
    for row in rows:
        try:
            sighting, is_zoned = _sighting(row, config, smoke_offset_m)
        except RowError as error:
            found.faults.append(f"{row.record.where}: {error}")
            continue
        zoneless += not is_zoned
        found.sightings.append(sighting)
        found.where.append(row.record.where)
    if smoke_offset_m is None and any(one.smoke_offset_m == BOX_SMOKE_M for one in found.sightings):
        found.notes.append(
            f"boxes are taken as about smoke: places are widened for a fire {BOX_SMOKE_M:.0f} m or more beside it; "
            "--smoke-offset 0 where the box is about the target itself"
        )
    if zoneless:
        found.notes.append(f"{zoneless} times without a zone: taken as UTC")
    if not found.sightings:
        first = f": {found.faults[0]}" if found.faults else ""
        raise SightingsError(f"{tables[0].path}: none of {sum(len(t.records) for t in tables)} rows can be used{first}")
    return found


def _tell_boxes(rows: list[_Row], found: Sightings) -> None:
    """What is taken for granted of boxes. A pitch of 0 that all of them have is one that nobody measured."""
    boxes = [row for row in rows if "h" in row.numbers or "y_max" in row.numbers or "y1" in row.numbers]
    boxes += [row for row in rows if "box" in row.texts]
    if len(boxes) >= _LEAST_BOXES and all(row.numbers.get("pitch_deg") == 0.0 for row in boxes):
        for row in boxes:
            del row.numbers["pitch_deg"]
        found.notes.append("pitch_deg is 0 in all rows with boxes: taken as not known, the boxes are bearings only")
    if any("azimuth_deg" in row.numbers for row in boxes):
        found.notes.append("azimuth beside a box: taken as the camera's; the smoke's goes into bearing_deg")


def _rows(table: Table, found: Sightings) -> list[_Row]:
    """Those that can be read; SightingsError where a column is plainly in another unit."""
    units: list[str] = []
    records = _marked(table, found)
    rows = [row for record in records if (row := _row(record, found, units)) is not None]
    if len(units) > 0.3 * len(table.records):
        raise SightingsError(f"{table.path}: {units[0]}, as {len(units)} of {len(table.records)} rows have it")
    return rows


def _marked(table: Table, found: Sightings) -> list[Record]:
    """Without the rows of named pictures in which nobody marked a pixel: their middle was not meant."""
    marked = [record for record in table.records if "picture" not in record.cells or _MARKS & record.cells.keys()]
    if len(marked) < len(table.records):
        unmarked = len(table.records) - len(marked)
        found.notes.append(f"{table.path.name}: {unmarked} pictures with nothing marked in u_px, v_px: not used")
    if not marked:
        raise SightingsError(f"{table.path}: nothing is marked in any of {len(table.records)} pictures: u_px, v_px")
    return marked


def _row(record: Record, found: Sightings, units: list[str]) -> _Row | None:
    try:
        if record.fault:
            raise RowError(record.fault)
        row = _Row(record, numbers_of(record), texts_of(record))
        lacking = [name for name in ("lat", "lon") if name not in row.numbers]
        if lacking:
            raise RowError(f"lacks {' and '.join(lacking)}: the camera's place, in degrees")
        return row
    except RowError as error:
        found.faults.append(f"{record.where}: {error}")
        if isinstance(error, UnitError):
            units.append(found.faults[-1])
        return None


def _on_one_datum(rows: list[_Row], geoid_m: float | None, found: Sightings) -> list[_Row]:
    """Heights of all rows over the sea, or all over the ellipsoid, as `alt_m`."""
    kept = []
    flat = 0
    has_msl = any(("alt_msl_m" in row.numbers) or ("alt_m" in row.numbers) for row in rows)
    bare = sum("alt_m" in row.numbers and "alt_msl_m" not in row.numbers for row in rows)
    found.is_ellipsoidal = geoid_m is None and not has_msl and any("alt_ellipsoidal_m" in row.numbers for row in rows)
    for row in rows:
        numbers = row.numbers
        if "alt_msl_m" in numbers:
            numbers["alt_m"] = numbers["alt_msl_m"]
        elif "alt_m" not in numbers and "alt_ellipsoidal_m" in numbers:
            if not found.is_ellipsoidal and geoid_m is None:
                found.faults.append(
                    f"{row.record.where}: alt_ellipsoidal_m {numbers['alt_ellipsoidal_m']:g} beside rows over the sea: "
                    "give --geoid, the geoid's height over the ellipsoid"
                )
                continue
            numbers["alt_m"] = numbers["alt_ellipsoidal_m"] - (geoid_m or 0.0)
        if "alt_m" not in numbers and not has_elevation(numbers):
            numbers["alt_m"] = 0.0
            flat += 1
        if "alt_m" not in numbers:
            found.faults.append(f"{row.record.where}: lacks an altitude: alt_msl_m, or alt_ellipsoidal_m")
            continue
        kept.append(row)
    if flat:
        found.notes.append(f"{flat} bearings without an altitude: taken as from the sea's level, which tells no range")
    if bare:
        found.notes.append(f"{bare} altitudes that don't say of what: taken as metres over the sea (alt_msl_m)")
    return kept


def _sighting(row: _Row, config: Config | None, smoke_offset_m: float | None) -> tuple[Sighting, bool]:
    numbers, texts = row.numbers, row.texts
    stamp_s, is_zoned = stamp_of(texts["time"]) if "time" in texts else (None, True)
    aimed = aim_of(numbers, texts, config)
    if smoke_offset_m is None:
        smoke_offset_m = BOX_SMOKE_M if aimed.is_box else 0.0
    one = Sighting(
        lat_deg=numbers["lat"],
        lon_deg=numbers["lon"],
        height_m=numbers["alt_m"],
        direction_enu=aimed.direction_enu,
        sigma_rad=aimed.sigma_rad,
        platform=texts.get("platform", ""),
        stamp_s=stamp_s,
        target=texts.get("target"),
        errors=_errors(numbers, config),
        heading_rad=math.radians(numbers["heading_deg"]) if "heading_deg" in numbers else None,
        heading_white_rad=math.radians(numbers["heading_white_deg"]) if "heading_white_deg" in numbers else None,
        smoke_offset_m=numbers.get("smoke_offset_m", smoke_offset_m),
    )
    return one, is_zoned


def _errors(numbers: dict[str, float], config: Config | None) -> PoseErrors | None:
    """The row's own sizes over the config's; None where it has none and there is no config."""
    base = (config or Config()).pose_errors.pose_errors()
    own = {key.replace("_deg", "_rad"): math.radians(numbers[key]) for key in _ERROR_KEYS if key in numbers}
    own |= {key: numbers[key] for key in ("position_m", "bias_time_constant_s") if key in numbers}
    return replace(base, **own) if own else (base if config is not None else None)
