"""The columns of a table of sightings: their names, units and ranges. docs/locate.md has the list for people."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import timezone

from distloc.batch.sighting import MOST_SMOKE_M
from service.common.iso_time import moment_from_iso
from service.recordings.sightings.reading import Record

_RAD, _FEET = 180.0 / math.pi, 0.3048


@dataclass(frozen=True, slots=True)
class Column:
    """A number: `name` is ours, `also` what others call it, with the factor that makes it ours."""

    name: str
    least: float
    most: float
    also: tuple[tuple[str, float], ...] = ()


def angle(name: str, least_deg: float, most_deg: float, *plain: str) -> Column:
    """A column of degrees, which may be in radians under a name that ends so."""
    stem = name.removesuffix("_deg")
    return Column(name, least_deg, most_deg, (*((one, 1.0) for one in plain), (f"{stem}_rad", _RAD)))


# A detector's box by its edges, or by a corner or its middle and its size; `boxes` says which are which.
EDGES = {
    "x_min": ("xmin", "minx", "left", "box_x_min"),
    "y_min": ("ymin", "miny", "top", "box_y_min"),
    "x_max": ("xmax", "maxx", "right", "box_x_max"),
    "y_max": ("ymax", "maxy", "bottom", "box_y_max"),
    **{f"{axis}{number}": () for axis in "xy" for number in "012"},
    "x": ("box_x", "bbox_x"),
    "y": ("box_y", "bbox_y"),
    "w": ("box_w", "bbox_w", "box_width", "bbox_width"),
    "h": ("box_h", "bbox_h", "box_height", "bbox_height"),
}
COLUMNS = {
    one.name: one
    for one in (
        Column("lat", -90.0, 90.0, (("lat_deg", 1.0), ("latitude", 1.0), ("lat_rad", _RAD))),
        Column(
            "lon",
            -180.0,
            360.0,
            (("lon_deg", 1.0), ("lng", 1.0), ("long", 1.0), ("longitude", 1.0), ("lon_rad", _RAD)),
        ),
        Column("alt_msl_m", -500.0, 30_000.0, (("alt_msl_ft", _FEET), ("altitude_msl_m", 1.0))),
        Column("alt_ellipsoidal_m", -600.0, 30_000.0, (("alt_ellipsoidal_ft", _FEET), ("height_ellipsoidal_m", 1.0))),
        Column(
            "alt_m",
            -600.0,
            30_000.0,
            (
                ("alt", 1.0),
                ("altitude", 1.0),
                ("altitude_m", 1.0),
                ("elevation_m", 1.0),
                ("elev_m", 1.0),
                ("elev", 1.0),
                ("alt_ft", _FEET),
            ),
        ),
        angle("azimuth_deg", -360.0, 360.0, "azimuth", "az"),
        angle("bearing_deg", -360.0, 360.0, "bearing", "smoke_azimuth", "target_azimuth"),
        angle("elevation_deg", -90.0, 90.0, "elevation"),
        angle("azimuth_sigma_deg", 0.0, 90.0, "bearing_sigma_deg"),
        angle("elevation_sigma_deg", 0.0, 90.0),
        angle("yaw_deg", -360.0, 360.0, "yaw", "camera_azimuth", "camera_azimuth_deg", "pan", "pan_deg"),
        angle("pitch_deg", -180.0, 180.0, "pitch", "tilt", "tilt_deg"),
        angle("roll_deg", -180.0, 180.0, "roll"),
        Column("u_px", -1e5, 1e5, (("u", 1.0), ("x_px", 1.0))),
        Column("v_px", -1e5, 1e5, (("v", 1.0), ("y_px", 1.0))),
        Column("sigma_px", 0.0, 1e4, (("pixel_sigma_px", 1.0),)),
        Column("width", 16.0, 100_000.0, (("width_px", 1.0), ("image_width", 1.0))),
        Column("height", 16.0, 100_000.0, (("height_px", 1.0), ("image_height", 1.0))),
        angle("hfov_deg", 0.1, 170.0, "hfov", "fov", "fov_deg", "angle_of_view", "field_of_view"),
        Column("fx", 1.0, 1e7, (("fx_px", 1.0),)),
        Column("fy", 1.0, 1e7, (("fy_px", 1.0),)),
        Column("cx", -1e5, 1e5, (("cx_px", 1.0),)),
        Column("cy", -1e5, 1e5, (("cy_px", 1.0),)),
        angle("heading_deg", -360.0, 360.0, "heading"),
        angle("heading_bias_deg", 0.001, 90.0),
        angle("tilt_bias_deg", 0.001, 90.0),
        angle("attitude_white_deg", 0.0001, 90.0),
        angle("heading_white_deg", 0.0, 90.0),
        Column("position_m", 0.001, 1000.0),
        *(Column(name, -1e5, 1e5, tuple((one, 1.0) for one in also)) for name, also in EDGES.items()),
        Column("bias_time_constant_s", 0.1, 1e9),
        Column("smoke_offset_m", 0.0, MOST_SMOKE_M),
    )
}
TEXTS = {
    "time": ("time_utc", "timestamp", "datetime", "stamp", "epoch", "unix_s", "created_at", "recorded_at"),
    "platform": ("camera", "tower", "drone", "vehicle", "station", "camera_id", "camera_name"),
    "target": ("fire", "target_id", "fire_id", "event", "incident"),
    "lens": ("projection", "lens_model"),
    "box": ("bbox", "bboxes"),
    "picture": (),
}


def by_name(columns: Iterable[Column]) -> dict[str, tuple[Column, float]]:
    """Each name that a column may have: the column, and the factor to its unit."""
    columns = tuple(columns)
    return {
        **{one.name: (one, 1.0) for one in columns},
        **{alias: (one, factor) for one in columns for alias, factor in one.also},
    }


_OURS = by_name(COLUMNS.values())
_OUR_TEXTS = {name: ours for ours, also in TEXTS.items() for name in (ours, *also)}


class RowError(Exception):
    """A row that can't be used: the cell and what it may be."""


class UnitError(RowError):
    """A number that shows its column to be in another unit: where many rows do, the others are wrong as well."""


def unknown_columns(names: Iterable[str], also: frozenset[str] = frozenset()) -> list[str]:
    """Those that say nothing to us, nor to who knows the columns `also`."""
    return [name for name in names if name and name not in _OURS and name not in _OUR_TEXTS and name not in also]


def numbers_of(record: Record, ours: Mapping[str, tuple[Column, float]] = _OURS) -> dict[str, float]:
    """A row's numbers by our names, in our units; RowError for what is none, or out of range.

    `ours` are the columns, `by_name`; those of sightings where not given.
    """
    found: dict[str, float] = {}
    for name, cell in _image_sizes_apart(record.cells).items():
        if name not in ours:
            continue
        column, factor = ours[name]
        if column.name in found:
            raise RowError(f"{name} {cell!r} beside another column for {column.name}: give one of them")
        found[column.name] = _checked(column, name, cell, factor)
    if found.get("lon", 0.0) > 180.0:
        found["lon"] -= 360.0
    return found


def _image_sizes_apart(cells: dict[str, str]) -> dict[str, str]:
    """Beside an image's size `width` and `height` are a box's."""
    if "image_width" not in cells or "image_height" not in cells:
        return cells
    return {{"width": "w", "height": "h"}.get(name, name): cell for name, cell in cells.items()}


def texts_of(record: Record) -> dict[str, str]:
    """A row's time, platform, target, lens and box; our own name goes before what others call it."""
    cells = {name: cell for name, cell in record.cells.items() if name in _OUR_TEXTS}
    return {_OUR_TEXTS[name]: cell for name, cell in sorted(cells.items(), key=lambda one: one[0] in TEXTS)}


def stamp_of(cell: str) -> tuple[float, bool]:
    """Seconds since 1970, and whether the cell said its zone; RowError for what is no time."""
    try:
        seconds = float(cell)
    except ValueError:
        pass
    else:
        if not math.isfinite(seconds) or abs(seconds) > 4e9:
            raise RowError(f"time {cell!r}: must be ISO 8601, as 2026-07-14T09:30:00Z, or seconds")
        return seconds, True
    try:
        moment = moment_from_iso(cell)
    except ValueError as error:
        raise RowError(f"time {cell!r}: must be ISO 8601, as 2026-07-14T09:30:00Z, or seconds") from error
    return moment.replace(tzinfo=moment.tzinfo or timezone.utc).timestamp(), moment.tzinfo is not None


def _checked(column: Column, name: str, cell: str, factor: float) -> float:
    try:
        value = float(cell)
    except ValueError as error:
        hint = "; decimal commas need another separator, as semicolons" if "," in cell else ""
        raise RowError(f"{name} {cell!r}: must be a number{hint}") from error
    if not math.isfinite(value):
        raise RowError(f"{name} {cell!r}: must be a number that is finite")
    least, most = column.least / factor, column.most / factor
    if not least <= value <= most:
        is_degrees = factor == _RAD and abs(value) <= 360.0
        fault = UnitError if is_degrees else RowError
        hint = f"; degrees go into {column.name}" if is_degrees else _hint(column, value, factor)
        raise fault(f"{name} {cell}: must be {least:.6g} to {most:.6g}{hint}")
    return value * factor


def _hint(column: Column, value: float, factor: float) -> str:
    if column.name == "lat" and abs(value) <= 180.0:
        return "; lat and lon may be swapped"
    if column.name == "elevation_deg":
        return "; the camera's height goes into alt_msl_m"
    if column.name.startswith("alt"):
        return "; feet go into a column that ends in _ft" if factor == 1.0 else ""
    return ""
