"""Rows as sightings: what each says of place, direction and errors, and what of the whole table looks wrong."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from distloc.batch.sighting import Sighting, direction_from_azimuth, direction_from_pixel
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.types import PoseErrors
from service.config.sections import Config, ConfigError
from service.recordings.sightings.columns import (
    COLUMNS,
    RowError,
    UnitError,
    numbers_of,
    stamp_of,
    texts_of,
    unknown_columns,
)
from service.recordings.sightings.reading import Record, SightingsError, Table
from service.recordings.sightings.suspects import far_apart, looks_like_radians

_ANY_ELEVATION_RAD = math.radians(10.0)  # one standard deviation, where only a bearing is given
_MARKED_PX = 3.0  # of a pixel that somebody or something marked
_MARKS = frozenset(
    name for column in ("u_px", "v_px", "azimuth_deg") for name in (column, *(also for also, _ in COLUMNS[column].also))
)
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
    tables: list[Table], config: Config | None, geoid_m: float | None, home: tuple[float, float] | None
) -> Sightings:
    """All rows that can be used; SightingsError where none can.

    `geoid_m` is the geoid's height over the ellipsoid, `home` a latitude and longitude near the cameras.
    """
    found = Sightings()
    for table in tables:
        unknown = unknown_columns(table.columns)
        if unknown:
            found.notes.append(f"{table.path.name}: columns not used: {', '.join(unknown)}")
    rows = [row for table in tables for row in _rows(table, found)]
    rows = _on_one_datum(rows, geoid_m, found)
    for wrong, line in far_apart([(row.numbers["lat"], row.numbers["lon"]) for row in rows], home).items():
        found.faults.append(f"{rows[wrong].record.where}: {line}")
        rows[wrong].numbers.clear()
    rows = [row for row in rows if row.numbers]
    if line := looks_like_radians(
        [row.numbers for row in rows], "azimuth_deg" if _has(rows, "azimuth_deg") else "yaw_deg"
    ):
        found.notes.append(line)
    zoneless = 0
    for row in rows:
        try:
            sighting, is_zoned = _sighting(row, config)
        except RowError as error:
            found.faults.append(f"{row.record.where}: {error}")
            continue
        zoneless += not is_zoned
        found.sightings.append(sighting)
        found.where.append(row.record.where)
    if zoneless:
        found.notes.append(f"{zoneless} times without a zone: taken as UTC")
    if not found.sightings:
        first = f": {found.faults[0]}" if found.faults else ""
        raise SightingsError(f"{tables[0].path}: none of {sum(len(t.records) for t in tables)} rows can be used{first}")
    return found


def _has(rows: list[_Row], name: str) -> bool:
    return any(name in row.numbers for row in rows)


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
        if "alt_m" not in numbers:
            found.faults.append(f"{row.record.where}: lacks an altitude: alt_msl_m, or alt_ellipsoidal_m")
            continue
        kept.append(row)
    if bare:
        found.notes.append(f"{bare} altitudes that don't say of what: taken as metres over the sea (alt_msl_m)")
    return kept


def _sighting(row: _Row, config: Config | None) -> tuple[Sighting, bool]:
    numbers, texts = row.numbers, row.texts
    stamp_s, is_zoned = stamp_of(texts["time"]) if "time" in texts else (None, True)
    one = Sighting(
        lat_deg=numbers["lat"],
        lon_deg=numbers["lon"],
        height_m=numbers["alt_m"],
        direction_enu=np.array([0.0, 1.0, 0.0]),
        platform=texts.get("platform", ""),
        stamp_s=stamp_s,
        target=texts.get("target"),
        errors=_errors(numbers, config),
        heading_rad=math.radians(numbers["heading_deg"]) if "heading_deg" in numbers else None,
        heading_white_rad=math.radians(numbers["heading_white_deg"]) if "heading_white_deg" in numbers else None,
    )
    if "azimuth_deg" in numbers:
        return _along_azimuth(one, numbers), is_zoned
    if "yaw_deg" in numbers and "pitch_deg" in numbers:
        return _through_pixel(one, numbers, config), is_zoned
    raise RowError("lacks a direction: azimuth_deg and elevation_deg, or yaw_deg, pitch_deg, roll_deg, u_px and v_px")


def _along_azimuth(one: Sighting, numbers: dict[str, float]) -> Sighting:
    elevation_rad = math.radians(numbers.get("elevation_deg", 0.0))
    is_bearing = "elevation_deg" not in numbers
    across_rad = math.radians(numbers.get("azimuth_sigma_deg", 0.0)) * math.cos(elevation_rad)
    upright_rad = math.radians(numbers.get("elevation_sigma_deg", 0.0))
    direction = direction_from_azimuth(math.radians(numbers["azimuth_deg"]), elevation_rad)
    return replace(
        one, direction_enu=direction, sigma_rad=(across_rad, _ANY_ELEVATION_RAD if is_bearing else upright_rad)
    )


def _through_pixel(one: Sighting, numbers: dict[str, float], config: Config | None) -> Sighting:
    camera = _camera(numbers, config)
    u_px, v_px = numbers.get("u_px"), numbers.get("v_px")
    if (u_px is None) is not (v_px is None):
        raise RowError("has one of u_px and v_px: give both, or neither for the picture's middle")
    if u_px is None or v_px is None:
        u_px, v_px = camera.cx, camera.cy
    if not (-0.5 <= u_px <= camera.width - 0.5 and -0.5 <= v_px <= camera.height - 0.5):
        raise RowError(f"u_px, v_px {u_px:g}, {v_px:g}: must lie in the picture of {camera.width} x {camera.height}")
    attitude = (math.radians(numbers.get(key, 0.0)) for key in ("yaw_deg", "pitch_deg", "roll_deg"))
    turned = R_cam_from_enu(matrix_from_euler(*attitude), np.eye(3))
    sigma_rad = numbers.get("sigma_px", _MARKED_PX) / camera.fx
    return replace(
        one, direction_enu=direction_from_pixel(camera, turned, u_px, v_px), sigma_rad=(sigma_rad, sigma_rad)
    )


def _camera(numbers: dict[str, float], config: Config | None) -> Camera:
    """Of the row's columns, else of the config."""
    sizes = "width" in numbers and "height" in numbers
    if sizes and all(key in numbers for key in ("fx", "fy", "cx", "cy")):
        fx, fy, cx, cy = (numbers[key] for key in ("fx", "fy", "cx", "cy"))
        return Camera(int(numbers["width"]), int(numbers["height"]), fx, fy, cx, cy)
    if sizes and "hfov_deg" in numbers:
        width, height = int(numbers["width"]), int(numbers["height"])
        f = width / 2.0 / math.tan(math.radians(numbers["hfov_deg"]) / 2.0)
        return Camera(width, height, f, f, (width - 1) / 2.0, (height - 1) / 2.0)
    if config is None:
        raise RowError("has yaw_deg and no lens: give width, height and hfov_deg (or fx, fy, cx, cy), or --config FILE")
    try:
        return config.camera.camera()
    except ConfigError as error:
        raise RowError(str(error)) from error


def _errors(numbers: dict[str, float], config: Config | None) -> PoseErrors | None:
    """The row's own sizes over the config's; None where it has none and there is no config."""
    base = (config or Config()).pose_errors.pose_errors()
    own = {key.replace("_deg", "_rad"): math.radians(numbers[key]) for key in _ERROR_KEYS if key in numbers}
    own |= {key: numbers[key] for key in ("position_m", "bias_time_constant_s") if key in numbers}
    return replace(base, **own) if own else (base if config is not None else None)
