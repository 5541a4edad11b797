"""Reads a table of poses, a row for each time or for each frame, with a film or a folder of frames beside it.

Its columns have the names of `distloc locate`'s table where they mean the same; docs/import.md has the list.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray
from service.recordings.importers.film import film_of
from service.recordings.importers.flight import (
    Attitudes,
    Film,
    Given,
    ImportedFlight,
    ImportRefusedError,
    Lens,
    Positions,
    Remarks,
    unknown,
)
from service.recordings.importers.rows import attitudes_of, count, positions_of
from service.recordings.sightings.columns import (
    COLUMNS,
    TEXTS,
    Column,
    RowError,
    UnitError,
    angle,
    by_name,
    numbers_of,
    stamp_of,
    texts_of,
)
from service.recordings.sightings.reading import Record, SightingsError, Table, read_table

_SHARED = ("lat", "lon", "alt_msl_m", "alt_ellipsoidal_m", "alt_m", "yaw_deg", "pitch_deg", "roll_deg")
_LENS = ("width", "height", "hfov_deg", "fx")
_OWN = (
    Column("above_home_m", -5_000.0, 20_000.0, (("rel_alt", 1.0), ("relative_alt_m", 1.0), ("height_m", 1.0))),
    angle("craft_yaw_deg", -360.0, 360.0, "craft_yaw"),
    angle("craft_pitch_deg", -180.0, 180.0, "craft_pitch"),
    angle("craft_roll_deg", -180.0, 180.0, "craft_roll"),
    Column("qw", -1.5, 1.5),
    Column("qx", -1.5, 1.5),
    Column("qy", -1.5, 1.5),
    Column("qz", -1.5, 1.5),
    Column("vn_mps", -500.0, 500.0),
    Column("ve_mps", -500.0, 500.0),
    Column("vd_mps", -500.0, 500.0),
    Column("frame", 0.0, 1e6, (("frame_number", 1.0),)),
)
_OURS = by_name([*(COLUMNS[name] for name in (*_SHARED, *_LENS)), *_OWN])
_MEASURES = ("lat", "lon", "yaw_deg", "craft_yaw_deg", "qw")  # one of them makes it a table of poses
_TIMES = ("time", *TEXTS["time"])
_EARLIEST_DATE_S = 3e8  # 1979: smaller times are seconds of their own
_MOST_BYTES = 48_000_000  # 9 hours at 20 rows a second; read as a whole they take 1 GB of memory
_UNIT_SHARE = 0.5
_CIRCLE = 2.0 * math.pi + 0.01
_LEAST_TURNS = 20  # rows that show what unit a heading has


@dataclass(frozen=True, slots=True)
class _Rows:
    """The rows that could be read: `numbers` (N,) by column, NaN where a cell is empty, and `time_s` (N,) or None."""

    numbers: dict[str, FloatArray]
    time_s: FloatArray | None


def is_table_of_poses(path: Path, suffix: str, head: bytes) -> bool:
    """Whether a file's first line names columns of poses."""
    if suffix not in (".csv", ".tsv", ".txt"):
        return False
    encoding = "utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    line = head.decode(encoding, errors="replace").lstrip().split("\n", 1)[0]
    for separator in (";", "\t", "|"):
        line = line.replace(separator, ",")
    names = {name.strip().strip('"').lower() for name in line.split(",")}
    return any(name in _OURS and _OURS[name][0].name in _MEASURES for name in names)


def read_csv_poses(path: Path, given: Given) -> ImportedFlight:
    """A table's places and attitudes, and the film that its column `frame` counts. ImportRefusedError, one line."""
    try:
        table = read_table(path, "poses", _MOST_BYTES)
    except SightingsError as error:
        raise ImportRefusedError(str(error)) from error
    remarks = Remarks()
    rows = _rows(table, given, remarks)
    lens, film = _film(path, table, given, remarks)
    time_s, epoch_s, is_by_frame = _times(path, rows, film)
    craft, camera = _attitudes(rows.numbers, time_s, remarks)
    positions = _positions(rows.numbers, time_s, remarks)
    if positions is None and craft is None and camera is None:
        raise ImportRefusedError(f"{path}: no row of {len(table.records)} holds a pose{_why(remarks)}")
    return ImportedFlight(
        path.name,
        epoch_s,
        positions=positions,
        craft=craft,
        camera=camera,
        lens=_lens(rows.numbers, lens),
        frames=film if is_by_frame else None,
        remarks=remarks,
    )


def _rows(table: Table, given: Given, remarks: Remarks) -> _Rows:
    unused = [name for name in table.columns if name and name not in _OURS and name not in ("stamp_us", *_TIMES)]
    if unused:
        remarks.found.append(f"columns not used: {', '.join(unused[:12])}")
    has_time = not {"stamp_us", *_TIMES}.isdisjoint(table.columns)
    kept: list[dict[str, float]] = []
    times: list[float] = []
    units, zoneless = [], 0
    for record in table.records:
        try:
            numbers = numbers_of(record, _OURS)
            time_s, has_zone = _time_of(record) if has_time else (np.nan, True)
        except UnitError as error:
            units.append(f"{record.where}: {error}")
            continue
        except RowError as error:
            count(remarks, f"row: {str(error).split(':', 1)[0].split()[0]} cannot be read", 1)
            continue
        zoneless += not has_zone
        times.append(time_s if has_zone else time_s - (given.utc_offset_s or 0.0))
        kept.append(numbers)
    if len(units) > _UNIT_SHARE * len(table.records):
        raise ImportRefusedError(f"{table.path}: {units[0]}, as {len(units)} of {len(table.records)} rows have it")
    count(remarks, "row: an angle out of range, as of another unit", len(units))
    if zoneless and given.utc_offset_s is None:
        remarks.assumed.append("times without a zone are UTC: --utc-offset mends that")
    if not kept:
        raise ImportRefusedError(f"{table.path}: no row of {len(table.records)} can be read{_why(remarks)}")
    names = {name for numbers in kept for name in numbers}
    _check_units(table.path, names, kept, table.columns, remarks)
    columns = {name: np.array([numbers.get(name, np.nan) for numbers in kept]) for name in names}
    return _Rows(columns, np.array(times) if has_time else None)


def _check_units(
    path: Path, names: set[str], kept: list[dict[str, float]], columns: Iterable[str], remarks: Remarks
) -> None:
    """A heading in degrees that turns by over half a circle within 6.28 degrees is radians, or in doubt."""
    for name in sorted(names & {"yaw_deg", "craft_yaw_deg"}):
        yaw = np.array([numbers[name] for numbers in kept if name in numbers])
        is_told_rad = any(_OURS[one][0].name == name and one.endswith("_rad") for one in columns if one in _OURS)
        if is_told_rad or len(yaw) < _LEAST_TURNS or np.abs(yaw).max() > _CIRCLE or np.ptp(yaw) < math.pi:
            continue
        if (np.abs(np.diff(yaw)) > 0.9 * _CIRCLE).any():
            raise ImportRefusedError(
                f"{path}: {name} jumps by 6.28 from row to row and is never larger: it is in radians, name it "
                f"{name.removesuffix('_deg')}_rad"
            )
        remarks.doubt.append(f"{name} is never over 6.28: if it is in radians, name it {name.removesuffix('_deg')}_rad")


def _time_of(record: Record) -> tuple[float, bool]:
    if "stamp_us" in record.cells:
        stamp = record.cells["stamp_us"]
        return stamp_of(f"{stamp[:-6] or '0'}.{stamp[-6:].zfill(6)}" if stamp.isdigit() else stamp)
    cell = texts_of(record).get("time")
    if cell is None:
        raise RowError("time: is empty")
    return stamp_of(cell)


def _film(path: Path, table: Table, given: Given, remarks: Remarks) -> tuple[Lens | None, Film | None]:
    """The film whose frames a column `frame` counts."""
    if "frame" not in table.columns and "frame_number" not in table.columns:
        return None, None
    if len(given.films) != 1:
        raise ImportRefusedError(f"{path}: has a column `frame`: give the one film that it counts beside it")
    lens, film, of_film = film_of(given.films[0])
    remarks.found.extend(of_film.found)
    return lens, film


def _times(path: Path, rows: _Rows, film: Film | None) -> tuple[FloatArray, float | None, bool]:
    """Each row's time, the epoch of its zero, and whether the film is on that clock."""
    if rows.time_s is not None:
        if float(np.median(rows.time_s)) > _EARLIEST_DATE_S:
            epoch_s = float(np.floor(rows.time_s.min()))
            return rows.time_s - epoch_s, epoch_s, False
        return rows.time_s, None, False
    if film is None or "frame" not in rows.numbers:
        raise ImportRefusedError(f"{path}: has neither a column `time` nor `frame`: when were the poses?")
    number = rows.numbers["frame"]
    is_known = np.isfinite(number) & (number < len(film.time_s))
    times_s = np.full(len(number), np.nan)
    times_s[is_known] = film.time_s[number[is_known].astype(np.int64)]
    return times_s, None, True


def _positions(numbers: dict[str, FloatArray], time_s: FloatArray, remarks: Remarks) -> Positions | None:
    if "lat" not in numbers or "lon" not in numbers:
        return None
    msl_m = numbers.get("alt_msl_m")
    if msl_m is None and "alt_m" in numbers:
        remarks.assumed.append("alt is over the sea: name it alt_ellipsoidal_m if it is not")
        msl_m = numbers["alt_m"]
    velocity = [numbers.get(name, np.full(len(time_s), np.nan)) for name in ("vn_mps", "ve_mps", "vd_mps")]
    return positions_of(
        time_s,
        numbers["lat"],
        numbers["lon"],
        remarks,
        alt_msl_m=msl_m,
        alt_ellipsoid_m=numbers.get("alt_ellipsoidal_m"),
        above_home_m=numbers.get("above_home_m"),
        velocity_ned_mps=np.stack(velocity, axis=1),
    )


def _attitudes(
    numbers: dict[str, FloatArray], time_s: FloatArray, remarks: Remarks
) -> tuple[Attitudes | None, Attitudes | None]:
    """The craft's and the camera's."""
    craft = _of_angles(numbers, time_s, "craft_", remarks)
    camera = _of_angles(numbers, time_s, "", remarks)
    if craft is None and all(name in numbers for name in ("qw", "qx", "qy", "qz")):
        q = np.stack([numbers[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
        craft = attitudes_of(time_s, q, remarks)
        remarks.found.append("the craft's attitude, qw to qz: from front, right, down to north, east, down")
    elif craft is not None:
        remarks.found.append("the craft's attitude, craft_yaw_deg, craft_pitch_deg, craft_roll_deg")
    if camera is not None:
        remarks.found.append("the camera's attitude, yaw_deg, pitch_deg, roll_deg; a craft's go into craft_yaw_deg ...")
    return craft, camera


def _of_angles(numbers: dict[str, FloatArray], time_s: FloatArray, prefix: str, remarks: Remarks) -> Attitudes | None:
    if f"{prefix}yaw_deg" not in numbers:
        return None
    angles_rad = [
        np.radians(numbers[f"{prefix}{name}"] if f"{prefix}{name}" in numbers else np.zeros(len(time_s)))
        for name in ("yaw_deg", "pitch_deg", "roll_deg")
    ]
    q = quaternion_from_euler(*angles_rad).T
    return attitudes_of(time_s, q, remarks, unknown(len(time_s), 3), "attitude" if prefix else "camera's attitude")


def _lens(numbers: dict[str, FloatArray], lens: Lens | None) -> Lens | None:
    width, height, hfov_deg, fx = (_first(numbers, name) for name in _LENS)
    if lens is None and (width is None or height is None):
        return None
    size = (lens.width, lens.height) if lens else (int(width or 0), int(height or 0))
    scale = size[0] / width if width else 1.0
    return Lens(*size, None if fx is None else fx * scale, hfov_deg)


def _first(numbers: dict[str, FloatArray], name: str) -> float | None:
    known = numbers.get(name, np.zeros(0))
    known = known[np.isfinite(known)]
    return float(known[0]) if len(known) else None


def _why(remarks: Remarks) -> str:
    return (
        ": " + ", ".join(f"{number} x {reason}" for reason, number in remarks.dropped.items())
        if remarks.dropped
        else ""
    )
