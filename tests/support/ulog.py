"""Writes PX4's ULog files as its file format's page defines them, by struct alone."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from tests.support.flown import EPOCH_S, HOME_ALT_M, LAT_DEG, LON_DEG, PICTURES_S, UNDULATION_M, Flown

BOOT_S = 33.25
_KINDS = {
    "uint64_t": "Q",
    "double": "d",
    "float": "f",
    "uint8_t": "B",
    "uint16_t": "H",
    "uint32_t": "I",
    "int32_t": "i",
}
# Fields in the order that they have on disk: the widest first, as PX4 sorts them.
TOPICS: dict[str, tuple[str, ...]] = {
    "vehicle_attitude": ("uint64_t timestamp", "uint64_t timestamp_sample", "float[4] q"),
    "vehicle_angular_velocity": ("uint64_t timestamp", "uint64_t timestamp_sample", "float[3] xyz"),
    "vehicle_global_position": (
        *("uint64_t timestamp", "uint64_t timestamp_sample", "double lat", "double lon"),
        *("float alt", "float alt_ellipsoid"),
    ),
    "vehicle_local_position": ("uint64_t timestamp", "float vx", "float vy", "float vz"),
    "sensor_gps": (
        *("uint64_t timestamp", "uint64_t time_utc_usec", "double latitude_deg", "double longitude_deg"),
        *("double altitude_msl_m", "double altitude_ellipsoid_m", "float eph", "float epv", "uint8_t fix_type"),
        "uint8_t satellites_used",
    ),
    "estimator_status": (
        *("uint64_t timestamp", "float mag_test_ratio", "float vel_test_ratio", "float pos_test_ratio"),
        *("float hgt_test_ratio", "uint16_t solution_status_flags"),
    ),
    "gimbal_device_attitude_status": ("uint64_t timestamp", "float[4] q", "uint16_t device_flags"),
    "camera_capture": ("uint64_t timestamp", "uint32_t seq"),
    "home_position": ("uint64_t timestamp", "double lat", "double lon", "float alt"),
}


def write_ulog(path: Path, flown: Flown, leave_out: Sequence[str] = (), gimbal_pitch_deg: float | None = None) -> Path:
    """The flight as a log; `gimbal_pitch_deg` adds a gimbal held north at such a pitch."""
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", round(BOOT_S * 1e6))]
    out.append(_message("B", bytes(40)))
    out += [_message("F", f"{name}:{';'.join(fields)};".encode()) for name, fields in TOPICS.items()]
    out.append(_message("I", b"\x11char[3] sys_name" + b"\0PX4"))
    kept = [name for name in TOPICS if name not in leave_out]
    ids = {name: number for number, name in enumerate(kept)}
    out += [_message("A", struct.pack("<BH", 0, number) + name.encode()) for name, number in ids.items()]
    rows = [(t_s, name, values) for t_s, name, values in _rows(flown, gimbal_pitch_deg) if name in ids]
    for t_s, name, values in sorted(rows, key=lambda one: one[0]):
        stamp = round((BOOT_S + t_s) * 1e6)
        out.append(_message("D", struct.pack("<H", ids[name]) + _data(name, stamp, values)))
    path.write_bytes(b"".join(out))
    return path


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _data(name: str, stamp: int, values: Sequence[float]) -> bytes:
    """The first field is the stamp, and so is `timestamp_sample`."""
    out, left = b"", list(values)
    for field in TOPICS[name]:
        kind, label = field.split(" ")
        base, _, count = kind.partition("[")
        for _ in range(int(count.rstrip("]") or 1)):
            value = stamp if label in ("timestamp", "timestamp_sample") else left.pop(0)
            out += struct.pack("<" + _KINDS[base], value if base in ("double", "float") else round(value))
    assert not left, name
    return out


def _rows(flown: Flown, gimbal_pitch_deg: float | None) -> list[tuple[float, str, tuple[float, ...]]]:
    rows: list[tuple[float, str, tuple[float, ...]]] = []
    rows.append((0.0, "home_position", (LAT_DEG, LON_DEG, HOME_ALT_M)))
    for t_s in flown.times_s(50.0):
        angles_rad = np.radians(flown.angles_deg(np.array([t_s]))[:, 0])
        rows.append((t_s, "vehicle_attitude", tuple(quaternion_from_euler(*angles_rad))))
        rows.append((t_s, "vehicle_angular_velocity", (0.01, 0.02, 0.03)))
        if gimbal_pitch_deg is not None:
            q = quaternion_from_euler(0.0, np.radians(gimbal_pitch_deg), 0.0)
            rows.append((t_s, "gimbal_device_attitude_status", (*q, 64 | 16)))
    for t_s in flown.times_s(5.0):
        at = np.array([t_s])
        lat, lon, alt = flown.place(at)[:, 0]
        rows.append((t_s, "vehicle_global_position", (lat, lon, alt, alt + UNDULATION_M)))
        rows.append((t_s, "vehicle_local_position", tuple(flown.velocity_mps(at)[:, 0])))
        utc_us = round((EPOCH_S + t_s) * 1e6)
        rows.append((t_s, "sensor_gps", (utc_us, lat, lon, alt, alt + UNDULATION_M, 0.8, 1.1, 3, 21)))
        rows.append((t_s, "estimator_status", (0.2, 0.1, 0.15, 0.05, 831)))
    rows += [(float(t_s), "camera_capture", (number,)) for number, t_s in enumerate(PICTURES_S)]
    return rows
