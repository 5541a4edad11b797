"""Reads ArduPilot's DataFlash logs, .bin and text .log, through pymavlink's reader, which never runs in flight.

Field names are those of ArduPilot's LogStructure. Times are TimeUS, since boot; GPS week and time of week date them.
"""

import contextlib
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray
from service.recordings.importers.flight import (
    Attitudes,
    Estimates,
    Fixes,
    Gimbal,
    Given,
    ImportedFlight,
    ImportRefusedError,
    Positions,
    Remarks,
)
from service.recordings.importers.logs.foreign import parsing
from service.recordings.importers.logs.undamaged import undamaged_copy
from service.recordings.importers.rows import (
    Rows,
    attitudes_of,
    count,
    fixes_of,
    home_of,
    most_rising,
    positions_of,
    sampled,
)

_WANTED = ("ATT", "AHR2", "RATE", "POS", "GPS", "GPA", "XKF1", "NKF1", "XKF4", "NKF4", "MNT", "CAM", "TRIG", "ORGN")
_PAGE_REST_BYTES = 528  # of logs that are written in blocks
_HEAD = b"\xa3\x95\x80"  # the first message is FMT's own
_GPS_EPOCH_S = 315_964_800  # 1980-01-06
_LEAP_S = 18.0  # since 2017
_WEEK_S = 604_800.0
_EARLIEST_WEEK, _LATEST_WEEK = 1564, 6260  # 2010 to 2100
_HOME_KIND = 1  # of ORGN; 0 is the estimator's origin
# From nav_filter_status' bits, as XKF4.SS has them, to EKF_STATUS_FLAGS: the first ten are alike.
_SAME_BITS, _GLITCHING, _INITIALISED = 0x3FF, 1 << 14, 1 << 16
_EKF_UNINITIALISED, _EKF_GLITCHING = 1024, 32768

Columns = dict[str, FloatArray]


def read_dataflash(path: Path, given: Given) -> ImportedFlight:
    """What the log tells of the flight. ImportRefusedError, one line, where it tells no pose."""
    remarks = Remarks()
    with parsing(path, "a DataFlash log"):
        tables = _tables(path, remarks)
    craft = _attitudes(tables, remarks)
    positions = _positions(tables, remarks)
    if craft is None and positions is None:
        held = ", ".join(sorted(tables)) or "none of " + ", ".join(_WANTED[:6])
        raise ImportRefusedError(f"{path}: a DataFlash log without attitudes (ATT) and places (POS): it holds {held}")
    return ImportedFlight(
        path.name,
        _epoch_s(tables.get("GPS")),
        positions=positions,
        craft=craft,
        gimbal=_gimbal(tables, remarks),
        fixes=_fixes(tables, remarks),
        estimates=_estimates(tables),
        home=_home(tables.get("ORGN")),
        triggers_s=_triggers_s(tables, remarks),
        remarks=remarks,
    )


def _tables(path: Path, remarks: Remarks) -> dict[str, Columns]:
    """The columns of each wanted message, by its fields' names, with `time_s`."""
    with _opened(path) as reader:
        if not _is_damaged(reader):
            return _columns(*_rows(path, reader))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "undamaged.bin"
        count(remarks, "place in the log where records are damaged", undamaged_copy(path, copy))
        with _opened(copy) as reader:
            return _columns(*_rows(path, reader))


def _columns(rows: dict[str, Rows], names: dict[str, tuple[str, ...]]) -> dict[str, Columns]:
    tables = {kind: dict(zip(names[kind], held.table().T, strict=True)) for kind, held in rows.items()}
    return {kind: {**table, "time_s": _time_s(table)} for kind, table in tables.items()}


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from pymavlink import DFReader

    with path.open("rb") as file:
        kind_of_reader = DFReader.DFReader_binary if file.read(2) == _HEAD[:2] else DFReader.DFReader_text
    reader = kind_of_reader.__new__(kind_of_reader)  # so that it can be closed where its constructor gives up
    try:
        kind_of_reader.__init__(reader, str(path))
        yield reader
    finally:
        for name in ("data_map", "filehandle"):
            with contextlib.suppress(AttributeError, BufferError):  # a view of the map may live on in a traceback
                getattr(reader, name).close()


def _is_damaged(reader: Any) -> bool:
    """Whether the index leaves out more of a binary log than a page's rest at its end."""
    formats = getattr(reader, "formats", None)
    if not isinstance(formats, dict) or 0x80 not in formats:
        return False
    held = sum(formats[kind].len * reader.counts[kind] for kind in range(256) if kind in formats)
    return bool(reader.data_len - held > _PAGE_REST_BYTES)


def _rows(path: Path, reader: Any) -> tuple[dict[str, Rows], dict[str, tuple[str, ...]]]:
    """Of each wanted message, and its fields' names."""
    rows: dict[str, Rows] = {}
    names: dict[str, tuple[str, ...]] = {}
    while (message := reader.recv_match(type=list(_WANTED), strict=True)) is not None:
        kind = message.get_type()
        if kind not in names:
            names[kind] = tuple(message.get_fieldnames())
            rows[kind] = Rows(len(names[kind]), f"{path}: {kind}")
        rows[kind].add(*(_number(getattr(message, name, np.nan)) for name in names[kind]))
    return rows, names


def _time_s(table: Columns) -> FloatArray:
    """Since boot; logs before 2015 have milliseconds."""
    for name, unit_s in (("TimeUS", 1e-6), ("TimeMS", 1e-3)):
        if name in table:
            return table[name] * unit_s
    return np.full(len(next(iter(table.values()))), np.nan)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _column(table: Columns, names: Iterable[str]) -> FloatArray:
    """The first of these columns that there is, else NaN: names changed over the years."""
    found = next((table[name] for name in names if name in table), None)
    return np.full(len(table["time_s"]), np.nan) if found is None else found


def _of_first(table: Columns, name: str, remarks: Remarks, kind: str) -> Columns:
    """The rows of the first instance alone."""
    if name not in table or not len(table["time_s"]):
        return table
    instances = np.unique(table[name][np.isfinite(table[name])])
    if len(instances) < 2:
        return table
    remarks.found.append(f"{kind}: {len(instances)} of them, number {instances[0]:.0f} is taken")
    is_first = table[name] == instances[0]
    return {key: column[is_first] for key, column in table.items()}


def _attitudes(tables: dict[str, Columns], remarks: Remarks) -> Attitudes | None:
    """ATT is the estimate that the craft flies by; AHR2, another one, stands in where a log lacks it."""
    kind = next((one for one in ("ATT", "AHR2") if one in tables), None)
    if kind is None:
        return None
    if kind == "AHR2":
        remarks.assumed.append("attitudes are AHR2's, the second estimate: the log has no ATT")
    table = tables[kind]
    angles_rad = [np.radians(_column(table, (name,))) for name in ("Yaw", "Pitch", "Roll")]
    return attitudes_of(
        table["time_s"], quaternion_from_euler(*angles_rad).T, remarks, _rates_rps(tables, table["time_s"])
    )


def _rates_rps(tables: dict[str, Columns], at_s: FloatArray) -> FloatArray | None:
    """The gyros' rates as RATE has them, where it is as frequent as the attitudes."""
    table = tables.get("RATE")
    if table is None or len(table["time_s"]) < 0.8 * len(at_s) or not all(name in table for name in "RPY"):
        return None
    return np.radians(sampled(table["time_s"], np.stack([table[name] for name in "RPY"], axis=1), at_s))


def _positions(tables: dict[str, Columns], remarks: Remarks) -> Positions | None:
    table = tables.get("POS")
    if table is None:
        table = _receiver(tables, remarks)
        if table is not None:
            remarks.assumed.append("places are the receiver's own: the log has no POS")
    if table is None:
        return None
    msl_m = _column(table, ("Alt",))
    return positions_of(
        table["time_s"],
        _column(table, ("Lat",)),
        _column(table, ("Lng", "Lon")),
        remarks,
        alt_msl_m=msl_m,
        alt_ellipsoid_m=msl_m + _undulation_m(tables),
        above_home_m=_column(table, ("RelHomeAlt", "RelAlt")),
        velocity_ned_mps=_velocity_mps(tables, table["time_s"]),
    )


def _velocity_mps(tables: dict[str, Columns], at_s: FloatArray) -> FloatArray | None:
    """Of the estimator that the craft flies by."""
    table = next((tables[one] for one in ("XKF1", "NKF1") if one in tables), None)
    if table is None or not all(name in table for name in ("VN", "VE", "VD")):
        return None
    core = _primary(tables)
    is_primary = table["C"] == core if "C" in table and (table["C"] == core).any() else np.ones(len(table["VN"]), bool)
    velocity = np.stack([table[name] for name in ("VN", "VE", "VD")], axis=1)
    return sampled(table["time_s"][is_primary], velocity[is_primary], at_s)


def _primary(tables: dict[str, Columns]) -> float:
    """The core that is flown by most of the time."""
    table = next((tables[one] for one in ("XKF4", "NKF4") if one in tables), {})
    cores = table.get("PI", np.zeros(0))
    cores = cores[np.isfinite(cores)]
    return float(np.median(cores)) if len(cores) else 0.0


def _receiver(tables: dict[str, Columns], remarks: Remarks) -> Columns | None:
    table = tables.get("GPS")
    if table is None:
        return None
    if "U" in table and (table["U"] == 1).any():  # the one in use
        is_used = table["U"] == 1
        return {key: column[is_used] for key, column in table.items()}
    return _of_first(table, "I", remarks, "receivers")


def _fixes(tables: dict[str, Columns], remarks: Remarks) -> Fixes | None:
    table = _receiver(tables, Remarks())
    if table is None:
        return None
    accuracy = tables.get("GPA")
    sizes: dict[str, FloatArray | None] = {"HAcc": None, "VAcc": None}
    if accuracy is not None:
        accuracy = _of_first(accuracy, "I", Remarks(), "")
        for name in sizes:
            sizes[name] = sampled(accuracy["time_s"], _column(accuracy, (name,))[:, None], table["time_s"])[:, 0]
    return fixes_of(
        table["time_s"],
        _column(table, ("Status",)),
        remarks,
        satellites=_column(table, ("NSats", "NSat")),
        h_acc_m=sizes["HAcc"],
        v_acc_m=sizes["VAcc"],
    )


def _undulation_m(tables: dict[str, Columns]) -> float:
    """The geoid's over the ellipsoid, as newer receivers' rows have it; NaN where not told."""
    und = tables.get("GPA", {}).get("Und", np.zeros(0))
    told = und[np.isfinite(und) & (und != 0.0)]
    return float(np.median(told)) if len(told) else np.nan


def _epoch_s(table: Columns | None) -> float | None:
    """UNIX time of boot."""
    if table is None:
        return None
    week, ms = _column(table, ("GWk", "Week")), _column(table, ("GMS", "TimeMS"))
    is_dated = (week >= _EARLIEST_WEEK) & (week <= _LATEST_WEEK) & np.isfinite(ms + table["time_s"])
    if not is_dated.any():
        return None
    utc_s = _GPS_EPOCH_S + week * _WEEK_S + ms * 1e-3 - _LEAP_S
    return float(np.median((utc_s - table["time_s"])[is_dated]))


def _estimates(tables: dict[str, Columns]) -> Estimates | None:
    table = next((tables[one] for one in ("XKF4", "NKF4") if one in tables), None)
    if table is None or "SS" not in table:
        return None
    if "C" in table and (table["C"] == _primary(tables)).any():
        is_primary = table["C"] == _primary(tables)
        table = {key: column[is_primary] for key, column in table.items()}
    kept = most_rising(table["time_s"])
    status = np.nan_to_num(table["SS"][kept]).astype(np.int64)
    flags = (status & _SAME_BITS) | np.where(status & _GLITCHING, _EKF_GLITCHING, 0)
    if (status >= _INITIALISED).any():  # of 32 bits
        flags |= np.where(status & _INITIALISED, 0, _EKF_UNINITIALISED)
    ratios = [_column(table, (name,))[kept] for name in ("SV", "SP", "SH", "SM")]
    velocity, position, height, compass = ratios
    return Estimates(table["time_s"][kept], flags, velocity, position, height, compass)


def _gimbal(tables: dict[str, Columns], remarks: Remarks) -> Gimbal | None:
    """MNT of 4.3 and later: yaw from the craft's nose; before it Roll, Pitch, Yaw of a mount without feedback."""
    table = tables.get("MNT")
    if table is None or "YawB" not in table:
        if table is not None:
            remarks.lacks.append("the gimbal's yaw: MNT of an ArduPilot before 4.3 is not used")
        return None
    table = _of_first(table, "I", remarks, "gimbals")
    angles_rad = [np.radians(_column(table, (name,))) for name in ("YawB", "Pitch", "Roll")]
    attitudes = attitudes_of(table["time_s"], quaternion_from_euler(*angles_rad).T, remarks, name="gimbal")
    return None if attitudes is None else Gimbal(attitudes, "vehicle")


def _home(table: Columns | None) -> tuple[float, float, float] | None:
    if table is None:
        return None
    is_home = table.get("Type", np.zeros(0)) == _HOME_KIND
    if not is_home.any():
        return None
    last = int(np.flatnonzero(is_home)[-1])
    return home_of(*(float(_column(table, (name,))[last]) for name in ("Lat", "Lng", "Alt")))


def _triggers_s(tables: dict[str, Columns], remarks: Remarks) -> FloatArray | None:
    """When the shutter was open by its own feedback (CAM), else when it was told to (TRIG)."""
    kind = next((one for one in ("CAM", "TRIG") if one in tables), None)
    if kind is None:
        return None
    times_s = tables[kind]["time_s"]
    kept = times_s[most_rising(times_s)]
    remarks.found.append(f"{len(kept)} releases of the camera ({kind})")
    return kept
