"""Reads PX4's .ulg logs through pyulog. Topics and fields are those of PX4's messages; times are since boot."""

from pathlib import Path
from typing import Any

import numpy as np

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
from service.recordings.importers.rows import (
    MOST_SAMPLES,
    attitudes_of,
    fixes_of,
    home_of,
    most_rising,
    positions_of,
    sampled,
)

_TOPICS = (
    "vehicle_attitude",
    "vehicle_angular_velocity",
    "vehicle_global_position",
    "vehicle_local_position",
    "vehicle_gps_position",
    "sensor_gps",
    "estimator_status",
    "estimator_status_flags",
    "gimbal_device_attitude_status",
    "camera_capture",
    "camera_trigger",
    "home_position",
)
_IN_EARTH_FRAME, _IN_VEHICLE_FRAME, _YAW_LOCK = 64, 32, 16  # of GIMBAL_DEVICE_FLAGS
_EARLIEST_UTC_S, _LATEST_UTC_S = 1.2623e9, 4.1025e9  # 2010 to 2100
# ESTIMATOR_STATUS_FLAGS, as solution_status_flags has them, to EKF_STATUS_FLAGS: the first ten are alike.
_SAME_BITS, _GLITCH, _ACCELEROMETER = 0x3FF, 1 << 10, 1 << 11
_EKF_UNINITIALISED, _EKF_GLITCHING = 1024, 32768

_QUATERNION = {"q[0]", "q[1]", "q[2]", "q[3]"}

Topic = dict[str, FloatArray]


def read_ulog(path: Path, given: Given) -> ImportedFlight:
    """What the log tells of the flight. ImportRefusedError, one line, where it tells no pose."""
    remarks = Remarks()
    with parsing(path, "a ULog"):
        topics = _topics(path, remarks)
    craft, positions = _attitudes(topics, remarks), _positions(topics, remarks)
    if craft is None and positions is None:
        raise ImportRefusedError(
            f"{path}: a ULog without vehicle_attitude and vehicle_global_position: it holds "
            f"{', '.join(sorted(topics)) or 'no topic of a flight'}"
        )
    return ImportedFlight(
        path.name,
        _epoch_s(topics),
        positions=positions,
        craft=craft,
        gimbal=_gimbal(topics, remarks),
        fixes=_fixes(topics, remarks),
        estimates=_estimates(topics),
        home=_home(topics.get("home_position")),
        triggers_s=_triggers_s(topics, remarks),
        remarks=remarks,
    )


def _topics(path: Path, remarks: Remarks) -> dict[str, Topic]:
    """The first instance of each topic."""
    try:
        from pyulog import ULog
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("pyulog"):
            raise
        raise ImportRefusedError(f"{path}: PX4's logs are read by pyulog: pip install '.[import]'") from error
    with path.open("rb") as file:
        log = ULog(file, list(_TOPICS))
    if log.file_corruption:
        remarks.lacks.append("parts of the log: it is damaged or cut off")
    if log.dropouts:
        remarks.lacks.append(f"{sum(one.duration for one in log.dropouts) * 1e-3:.1f} s that the logger dropped")
    topics: dict[str, Topic] = {}
    for one in sorted(log.data_list, key=lambda data: data.multi_id):
        if one.name not in topics and len(one.data.get("timestamp", ())):
            if len(one.data["timestamp"]) > MOST_SAMPLES:
                raise ImportRefusedError(f"{path}: more than {MOST_SAMPLES} rows of {one.name}: cut it")
            topics[one.name] = {name: np.asarray(column, dtype=np.float64) for name, column in one.data.items()}
    for topic in topics.values():
        stamp = topic.get("timestamp_sample", topic["timestamp"])
        topic["time_s"] = np.where(stamp > 0, stamp, topic["timestamp"]) * 1e-6
    return topics


def _at(topic: Topic | None, names: tuple[str, ...], at_s: FloatArray) -> FloatArray | None:
    """Columns (len(at_s), n) between a topic's rows, NaN farther than a second from them; None where it lacks them."""
    if topic is None or not all(name in topic for name in names):
        return None
    return sampled(topic["time_s"], np.stack([topic[name] for name in names], axis=1), at_s)


def _attitudes(topics: dict[str, Topic], remarks: Remarks) -> Attitudes | None:
    topic = topics.get("vehicle_attitude")
    if topic is None or not topic.keys() >= _QUATERNION:
        return None
    q = np.stack([topic[f"q[{i}]"] for i in range(4)], axis=1)
    rates = _at(topics.get("vehicle_angular_velocity"), ("xyz[0]", "xyz[1]", "xyz[2]"), topic["time_s"])
    return attitudes_of(topic["time_s"], q, remarks, rates)


def _positions(topics: dict[str, Topic], remarks: Remarks) -> Positions | None:
    topic = topics.get("vehicle_global_position")
    if topic is None:
        topic = _receiver(topics)
        if topic is not None:
            remarks.assumed.append("places are the receiver's own: the log has no vehicle_global_position")
    if topic is None or not {"lat", "lon"} <= topic.keys():
        return None
    velocity = _at(topics.get("vehicle_local_position"), ("vx", "vy", "vz"), topic["time_s"])
    if velocity is None and {"vel_n", "vel_e", "vel_d"} <= topic.keys():  # before PX4 1.12
        velocity = np.stack([topic[name] for name in ("vel_n", "vel_e", "vel_d")], axis=1)
    return positions_of(
        topic["time_s"],
        topic["lat"],
        topic["lon"],
        remarks,
        alt_msl_m=topic.get("alt"),
        alt_ellipsoid_m=topic.get("alt_ellipsoid"),
        velocity_ned_mps=velocity,
    )


def _receiver(topics: dict[str, Topic]) -> Topic | None:
    """The receiver in use, in degrees and metres: what PX4 blended, else the first; their units changed in 1.14."""
    topic = topics.get("vehicle_gps_position") or topics.get("sensor_gps")
    if topic is None:
        return None
    topic = dict(topic)
    if "latitude_deg" in topic:
        names = {"lat": "latitude_deg", "lon": "longitude_deg", "alt": "altitude_msl_m"}
        names["alt_ellipsoid"] = "altitude_ellipsoid_m"
        topic |= {ours: topic[theirs] for ours, theirs in names.items() if theirs in topic}
    else:
        units = {"lat": 1e-7, "lon": 1e-7, "alt": 1e-3, "alt_ellipsoid": 1e-3}
        topic |= {name: topic[name] * unit for name, unit in units.items() if name in topic}
    return topic


def _fixes(topics: dict[str, Topic], remarks: Remarks) -> Fixes | None:
    topic = _receiver(topics)
    if topic is None or "fix_type" not in topic:
        return None
    return fixes_of(
        topic["time_s"],
        topic["fix_type"],
        remarks,
        satellites=topic.get("satellites_used"),
        h_acc_m=topic.get("eph"),
        v_acc_m=topic.get("epv"),
    )


def _epoch_s(topics: dict[str, Topic]) -> float | None:
    """UNIX time of boot, by the receiver's UTC."""
    topic = _receiver(topics)
    if topic is None or "time_utc_usec" not in topic:
        return None
    utc_s = topic["time_utc_usec"] * 1e-6
    is_dated = (utc_s > _EARLIEST_UTC_S) & (utc_s < _LATEST_UTC_S)
    return float(np.median((utc_s - topic["time_s"])[is_dated])) if is_dated.any() else None


def _estimates(topics: dict[str, Topic]) -> Estimates | None:
    topic = topics.get("estimator_status")
    if topic is not None and "solution_status_flags" in topic:
        status = topic["solution_status_flags"].astype(np.int64)
        flags = status & _SAME_BITS
        flags |= np.where(status & _GLITCH, _EKF_GLITCHING, 0) | np.where(
            status & _ACCELEROMETER, _EKF_UNINITIALISED, 0
        )
        return _with_ratios(topic, flags)
    topic = topics.get("estimator_status_flags")
    if topic is None:
        return None
    has_attitude = _is_set(topic, "cs_tilt_align") & _is_set(topic, "cs_yaw_align")
    is_placed = _is_set(topic, "cs_gps") | _is_set(topic, "cs_gnss_pos")
    has_height = _is_set(topic, "cs_baro_hgt") | _is_set(topic, "cs_gps_hgt") | _is_set(topic, "cs_rng_hgt")
    is_rejected = _is_set(topic, "reject_hor_pos") | _is_set(topic, "reject_hor_vel")
    flags = has_attitude * 1 + is_placed * (2 | 8 | 16) + has_height * (4 | 32) + is_rejected * _EKF_GLITCHING
    return _with_ratios(topic, flags.astype(np.int64))


def _is_set(topic: Topic, name: str) -> Any:
    return topic.get(name, np.zeros(len(topic["time_s"]))) > 0


def _with_ratios(topic: Topic, flags: Any) -> Estimates:
    kept = most_rising(topic["time_s"])
    names = ("vel_test_ratio", "pos_test_ratio", "hgt_test_ratio", "mag_test_ratio")
    velocity, position, height, compass = (
        topic.get(name, np.full(len(topic["time_s"]), np.nan))[kept] for name in names
    )
    return Estimates(topic["time_s"][kept], flags[kept], velocity, position, height, compass)


def _gimbal(topics: dict[str, Topic], remarks: Remarks) -> Gimbal | None:
    topic = topics.get("gimbal_device_attitude_status")
    if topic is None or not topic.keys() >= _QUATERNION:
        return None
    q = np.stack([topic[f"q[{i}]"] for i in range(4)], axis=1)
    attitudes = attitudes_of(topic["time_s"], q, remarks, name="gimbal")
    if attitudes is None:
        return None
    flags = topic.get("device_flags", np.zeros(len(q))).astype(np.int64)
    is_named = flags & (_IN_EARTH_FRAME | _IN_VEHICLE_FRAME)
    is_earth = np.where(is_named, flags & _IN_EARTH_FRAME, flags & _YAW_LOCK) > 0
    if 0 < is_earth.mean() < 1:
        remarks.lacks.append("the gimbal's attitude: the frame of its yaw changes in flight")
        return None
    return Gimbal(attitudes, "earth" if is_earth.all() else "vehicle")


def _home(topic: Topic | None) -> tuple[float, float, float] | None:
    if topic is None or not {"lat", "lon", "alt"} <= topic.keys():
        return None
    return home_of(topic["lat"][-1], topic["lon"][-1], topic["alt"][-1])


def _triggers_s(topics: dict[str, Topic], remarks: Remarks) -> FloatArray | None:
    """When the shutter was open by its own feedback, else when it was told to."""
    name = next((one for one in ("camera_capture", "camera_trigger") if one in topics), None)
    if name is None:
        return None
    times_s = topics[name]["timestamp"] * 1e-6
    kept = times_s[most_rising(times_s)]
    remarks.found.append(f"{len(kept)} releases of the camera ({name})")
    return kept
