"""Writes ArduPilot's DataFlash logs as its LogStructure and the log's own FMT messages define them, by struct alone."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.support.flown import EPOCH_S, HOME_ALT_M, LAT_DEG, LON_DEG, PICTURES_S, UNDULATION_M, Flown

HEAD = b"\xa3\x95"
LEAP_S, GPS_EPOCH_S = 18, 315_964_800
BOOT_S = 12.5  # of the log's clock at the flight's start
_STRUCT = {"Q": "Q", "B": "B", "b": "b", "c": "h", "C": "H", "L": "i", "f": "f", "I": "I", "H": "H", "e": "i"}
_SCALE = {"c": 100.0, "C": 100.0, "e": 100.0, "L": 1e7}
# name: (type, format, columns), as ArduPilot 4.5 has them, cut to what a reader needs and a little more
MESSAGES = {
    "ATT": (10, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "POS": (11, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "GPS": (12, "QBBIHBcLLefffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,U"),
    "GPA": (13, "QBCCCCfBIHf", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und"),
    "XKF1": (14, "QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"),
    "XKF4": (15, "QBcccccfffHBIHb", "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI"),
    "MNT": (16, "QBffffffff", "TimeUS,I,DesRoll,Roll,DesPitch,Pitch,DesYawB,YawB,DesYawE,YawE"),
    "CAM": (17, "QBHIHLLeeeccC", "TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt,R,P,Y"),
    "ORGN": (18, "QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
}


def write_dataflash(
    path: Path, flown: Flown, leave_out: Sequence[str] = (), mount_deg: tuple[float, float] | None = None
) -> Path:
    """The flight as a log; `mount_deg` adds a gimbal held at such a pitch and yaw from the nose, level in roll."""
    path.write_bytes(b"".join(_formats()) + b"".join(data for _, data in sorted(_rows(flown, leave_out, mount_deg))))
    return path


def row(name: str, *values: float) -> bytes:
    """One message."""
    kind, form, columns = MESSAGES[name]
    assert len(values) == len(columns.split(",")) == len(form), name
    scaled = [value if c == "f" else round(value * _SCALE.get(c, 1.0)) for c, value in zip(form, values, strict=True)]
    return HEAD + bytes([kind]) + struct.pack("<" + "".join(_STRUCT[c] for c in form), *scaled)


def _formats() -> list[bytes]:
    out = [_format(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for name, (kind, form, columns) in MESSAGES.items():
        length = 3 + struct.calcsize("<" + "".join(_STRUCT[c] for c in form))
        out.append(_format(kind, length, name, form, columns))
    return out


def _format(kind: int, length: int, name: str, form: str, columns: str) -> bytes:
    return HEAD + b"\x80" + struct.pack("<BB4s16s64s", kind, length, name.encode(), form.encode(), columns.encode())


def _rows(flown: Flown, leave_out: Sequence[str], mount_deg: tuple[float, float] | None) -> list[tuple[float, bytes]]:
    rows: list[tuple[float, bytes]] = []

    def add(name: str, t_s: float, *values: float) -> None:
        if name not in leave_out:
            rows.append((t_s, row(name, round((BOOT_S + t_s) * 1e6), *values)))

    add("ORGN", 0.0, 0, LAT_DEG + 0.1, LON_DEG, HOME_ALT_M - 3.0)
    add("ORGN", 0.0, 1, LAT_DEG, LON_DEG, HOME_ALT_M)
    for t_s in flown.times_s(25.0):
        yaw, pitch, roll = flown.angles_deg(np.array([t_s]))[:, 0]
        add("ATT", t_s, 0.0, roll, 0.0, pitch, 0.0, yaw, 0.0, 0.0, 3)
        if mount_deg:
            add("MNT", t_s, 0, 0.0, 0.0, 0.0, mount_deg[0], 0.0, mount_deg[1], 0.0, np.nan)
    for t_s in flown.times_s(10.0):
        at = np.array([t_s])
        (lat, lon, alt), (vn, ve, vd) = flown.place(at)[:, 0], flown.velocity_mps(at)[:, 0]
        add("POS", t_s, lat, lon, alt, alt - HOME_ALT_M, 0.0)
        add("XKF1", t_s, 1, 0.0, 0.0, 0.0, -vn, ve, vd)  # not the primary core
        add("XKF1", t_s + 1e-6, 0, 0.0, 0.0, 0.0, vn, ve, vd)
        add("XKF4", t_s, 0, 0.1, 0.12, 0.05, 0.2, 0.0, 0.0, 0.0, 0.0, 0, 0, 831 | 1 << 13 | 1 << 16, 0, 0)
    for t_s in flown.times_s(5.0):
        lat, lon, alt = flown.place(np.array([t_s]))[:, 0]
        gps_ms = round((EPOCH_S + t_s + LEAP_S - GPS_EPOCH_S) * 1e3)
        week, ms = divmod(gps_ms, 604_800_000)
        add("GPS", t_s, 0, 4, ms, week, 17, 0.7, lat, lon, alt, 0.0, 0.0, 0.0, 1)
        add("GPA", t_s, 0, 1.0, 0.9, 1.4, 0.2, 0.0, 1, 0, 200, UNDULATION_M)
    for number, t_s in enumerate(PICTURES_S):
        add("CAM", t_s, 0, number, 0, 0, LAT_DEG, LON_DEG, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return rows
