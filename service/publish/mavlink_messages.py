"""The MAVLink messages that the service sends, made from its own types; docs/mavlink.md says what each means. Used by
`publish.mavlink`. Numbers that do not fit their field are clamped, never raised over."""

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from distloc.types import FloatArray, TargetState
from service.common.messages import LocatedTarget, VehicleState

SIGMA_FROM_95 = 1.0 / 2.4477  # a plane Gaussian's 95 % ellipse has semi-axes of 2.4477 sigma
VERTICAL_SIGMA_FROM_95 = 1.0 / 1.95996
FLOAT_MAX = 3.4e38
STATUSTEXT_SIZE = 50
ICAO_BASE = 0xF1E000
UNKNOWN, AT_INFINITY = 2**31 - 1, -(2**31)
ELLIPSE_NAME, ELLIPSE_VERSION = b"FIRE_ELL", 1.0
_FINGER = 0.05  # of the image's sides
_STATE_NUMBER = {
    TargetState.TENTATIVE: 1.0,
    TargetState.CONFIRMED: 2.0,
    TargetState.COASTING: 3.0,
    TargetState.DISMISSED: 4.0,
}
_FRD_FROM_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_INTEGER_RANGE = {
    "uint8_t": (0, 2**8 - 1),
    "int8_t": (-(2**7), 2**7 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
}

Message = Any  # pymavlink's classes carry no types


def packed(encoder: Any, message: Message) -> bytes:
    """The frame's bytes with the encoder's next sequence number."""
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        value = getattr(message, name)
        if isinstance(value, list | tuple):
            setattr(message, name, [_fitting(item, kind) for item in value])
        elif not isinstance(value, bytes | str):
            setattr(message, name, _fitting(value, kind))
    raw = bytes(message.pack(encoder))
    encoder.seq = (encoder.seq + 1) % 256
    return raw


def _fitting(value: float, kind: str) -> float | int:
    if kind not in _INTEGER_RANGE:
        number = float(value)
        return number if not math.isfinite(number) else min(FLOAT_MAX, max(-FLOAT_MAX, number))
    low, high = _INTEGER_RANGE[kind]
    if isinstance(value, float):
        if math.isnan(value):
            return 0
        value = round(min(float(high), max(float(low), value)))
    return min(high, max(low, int(value)))


def is_placed(target: LocatedTarget) -> bool:
    """Whether its place and ellipse are finite: what is not has no business on a map."""
    ellipse = target.estimate.ellipse95
    return bool(
        np.isfinite([target.place.lat_deg, target.place.lon_deg, ellipse.semi_major_m, ellipse.semi_minor_m]).all()
    )


def deg_e7(angle_deg: float) -> float:
    """Degrees in MAVLink's 1e-7."""
    return angle_deg * 1e7


def heartbeat(kind: int, is_healthy: bool) -> Message:
    """HEARTBEAT of a component that is no autopilot."""
    state = mavlink.MAV_STATE_ACTIVE if is_healthy else mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3)


def confirmed_text(target: LocatedTarget) -> bytes:
    """`Smoke 3 47.42774N 8.60559E +-180x60m 4.1km`, never over 50 bytes: decimals go first."""
    estimate, place = target.estimate, target.place
    ellipse = estimate.ellipse95
    size = f"+-{_short(ellipse.semi_major_m)}x{_short(ellipse.semi_minor_m)}m"
    distance = f"{min(estimate.range_m, 99e3) / 1000:.1f}km" if math.isfinite(estimate.range_m) else ""
    text = ""
    for decimals in (5, 4, 3):
        lat = f"{abs(place.lat_deg):.{decimals}f}{'N' if place.lat_deg >= 0 else 'S'}"
        lon = f"{abs(place.lon_deg):.{decimals}f}{'E' if place.lon_deg >= 0 else 'W'}"
        text = f"Smoke {estimate.id} {lat} {lon} {size} {distance}".rstrip()
        if len(text) <= STATUSTEXT_SIZE:
            break
    return text.encode("ascii", "replace")[:STATUSTEXT_SIZE]


def given_up_text(target_id: int) -> bytes:
    """`Smoke 3 given up`."""
    return f"Smoke {target_id} given up".encode()[:STATUSTEXT_SIZE]


def _short(value_m: float) -> str:
    return f"{min(value_m, 99_999.0):.0f}" if math.isfinite(value_m) else "?"


def ellipse_array(target: LocatedTarget, boot_ms: int) -> Message:
    """DEBUG_FLOAT_ARRAY FIRE_ELL; the layout is in docs/mavlink.md."""
    estimate, place = target.estimate, target.place
    ellipse = estimate.ellipse95
    data = [
        ELLIPSE_VERSION,
        _STATE_NUMBER[estimate.state],
        *_split(place.lat_deg),
        *_split(place.lon_deg),
        place.alt_msl_m,
        ellipse.semi_major_m,
        ellipse.semi_minor_m,
        math.degrees(ellipse.azimuth_rad),
        estimate.vertical95_m,
        estimate.range_m,
        math.degrees(estimate.bearing_rad),
        estimate.extent.width_m,
        estimate.extent.height_m,
        estimate.existence,
        float(estimate.observations),
        max(0.0, target.time_utc_s - target.last_seen_utc_s),
    ]
    data += [0.0] * (58 - len(data))
    return mavlink.MAVLink_debug_float_array_message(boot_ms * 1000, ELLIPSE_NAME, estimate.id & 0xFFFF, data)


def _split(value: float) -> tuple[float, float]:
    """`value` as the sum of two float32: one alone is a metre coarse in a longitude."""
    coarse = float(np.float32(min(FLOAT_MAX, max(-FLOAT_MAX, value))))
    return coarse, value - coarse


def named_values(target: LocatedTarget, boot_ms: int) -> list[Message]:
    """The ellipse as quick values for Mission Planner: 95 % semi-axes, bearing in degrees, distance."""
    estimate = target.estimate
    values = {
        b"FireSMaj": estimate.ellipse95.semi_major_m,
        b"FireSMin": estimate.ellipse95.semi_minor_m,
        b"FireBrg": math.degrees(estimate.bearing_rad) % 360.0,
        b"FireDist": estimate.range_m,
    }
    return [mavlink.MAVLink_named_value_float_message(boot_ms, name, value) for name, value in values.items()]


def geo_status(target: LocatedTarget) -> Message:
    """CAMERA_TRACKING_GEO_STATUS: accuracies are one sigma; a fire has no velocity that we know."""
    estimate, nan = target.estimate, math.nan
    return mavlink.MAVLink_camera_tracking_geo_status_message(
        mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE,
        deg_e7(target.place.lat_deg),
        deg_e7(target.place.lon_deg),
        target.place.alt_msl_m,
        estimate.ellipse95.semi_major_m * SIGMA_FROM_95,
        estimate.vertical95_m * VERTICAL_SIGMA_FROM_95,
        nan,
        nan,
        nan,
        nan,
        estimate.range_m,
        estimate.bearing_rad,
        nan,
    )


def image_status(target: LocatedTarget | None, vehicle: VehicleState | None, camera: Camera) -> Message:
    """CAMERA_TRACKING_IMAGE_STATUS: ACTIVE with a point and a box where the target is in view, else IDLE."""
    box = None if target is None or vehicle is None else _box(target, vehicle, camera)
    if box is None:
        values = [math.nan] * 7
        return mavlink.MAVLink_camera_tracking_image_status_message(0, 0, 0, *values)
    x, y, half_x, half_y = box
    return mavlink.MAVLink_camera_tracking_image_status_message(
        mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE,
        mavlink.CAMERA_TRACKING_MODE_POINT,
        mavlink.CAMERA_TRACKING_TARGET_DATA_IN_STATUS,
        x,
        y,
        max(half_x, half_y * camera.height / camera.width),
        *(max(0.0, x - half_x), max(0.0, y - half_y), min(1.0, x + half_x), min(1.0, y + half_y)),
    )


def _box(target: LocatedTarget, vehicle: VehicleState, camera: Camera) -> tuple[float, float, float, float] | None:
    """Centre and half sizes as shares of the image, from the extent or, where it is wider, one sigma of the place."""
    pose, estimate = vehicle.pose, target.estimate
    point_cam_m = pose.R_cam_from_enu @ (estimate.position_enu_m - pose.position_enu_m)
    if not np.isfinite(point_cam_m).all():
        return None
    pixels, is_visible = camera.project(point_cam_m.reshape(3, 1))
    if not is_visible[0]:
        return None
    u, v = pixels[:, 0]
    half_m = [
        0.5 * size if math.isfinite(size) else 0.0 for size in (estimate.extent.width_m, estimate.extent.height_m)
    ]
    depth_m = float(point_cam_m[2])
    half_x = max(0.01, camera.fx * half_m[0] / depth_m / camera.width)
    half_y = max(0.01, camera.fy * half_m[1] / depth_m / camera.height)
    return float((u + 0.5) / camera.width), float((v + 0.5) / camera.height), min(1.0, half_x), min(1.0, half_y)


def is_on_target(x: float, y: float, target: LocatedTarget, vehicle: VehicleState, camera: Camera) -> bool:
    """Whether a point of the image, as shares of its sides, is on the target's box or beside it by a finger's width."""
    box = _box(target, vehicle, camera)
    if box is None:
        return False
    centre_x, centre_y, half_x, half_y = box
    return abs(x - centre_x) <= half_x + _FINGER and abs(y - centre_y) <= half_y + _FINGER


def fov_status(vehicle: VehicleState, camera: Camera, boot_ms: int) -> Message:
    """CAMERA_FOV_STATUS; the image's centre is unknown where home's altitude is, or beyond the ground's end."""
    place, R_enu_from_cam = vehicle.place, vehicle.pose.R_cam_from_enu.T
    lat_image: float = UNKNOWN
    lon_image: float = UNKNOWN
    alt_image: float = UNKNOWN
    if R_enu_from_cam[2, 2] >= 0.0:
        lat_image = lon_image = alt_image = AT_INFINITY
    elif (centre := vehicle.image_centre) is not None:
        lat_image, lon_image, alt_image = deg_e7(centre.lat_deg), deg_e7(centre.lon_deg), centre.alt_msl_m * 1000.0
    known = [deg_e7(place.lat_deg), deg_e7(place.lon_deg), place.alt_msl_m * 1000.0]
    lat, lon, alt = (value if math.isfinite(value) else UNKNOWN for value in known)
    quaternion = _quaternion(_ENU_FROM_NED.T @ R_enu_from_cam @ _FRD_FROM_CAM.T)
    return mavlink.MAVLink_camera_fov_status_message(
        boot_ms, lat, lon, alt, lat_image, lon_image, alt_image, quaternion, *map(math.degrees, camera.fov_rad)
    )


def _quaternion(R: FloatArray) -> list[float]:
    """w, x, y, z with w >= 0: the eigenvector of Bar-Itzhack's symmetric matrix (2000); identity if not finite."""
    if not np.isfinite(R).all():
        return [1.0, 0.0, 0.0, 0.0]
    K = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [0.0, R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
            [0.0, 0.0, R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]],
            [0.0, 0.0, 0.0, R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    q = np.linalg.eigh(K, UPLO="U")[1][:, -1]
    return [float(value) for value in (q if q[0] >= 0 else -q)]


def camera_information(camera: Camera, boot_ms: int) -> Message:
    """CAMERA_INFORMATION: a camera that tracks and says where; no control.

    QGroundControl draws the tracked box only of cameras that say that a point can be tracked.
    """
    vendor, model = (list(name.ljust(32, b"\0")) for name in (b"distloc", b"smoke locator"))
    flags = mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_GEO_STATUS
    size = (camera.width, camera.height)
    nan = math.nan
    return mavlink.MAVLink_camera_information_message(boot_ms, vendor, model, 1, nan, nan, nan, *size, 0, flags, 0, b"")


def adsb_vehicle(target: LocatedTarget, age_s: float) -> Message:
    """ADSB_VEHICLE as a point obstacle: a pin on the map. Only ever for a ground station."""
    place = target.place
    flags = mavlink.ADSB_FLAGS_VALID_COORDS | mavlink.ADSB_FLAGS_VALID_ALTITUDE | mavlink.ADSB_FLAGS_VALID_CALLSIGN
    callsign = f"SMK{target.estimate.id % 100_000}".encode()
    return mavlink.MAVLink_adsb_vehicle_message(
        ICAO_BASE + target.estimate.id % 0x1000,
        deg_e7(place.lat_deg),
        deg_e7(place.lon_deg),
        mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        place.alt_msl_m * 1000.0,
        *(0, 0, 0),
        callsign,
        mavlink.ADSB_EMITTER_TYPE_POINT_OBSTACLE,
        age_s,
        flags,
        0,
    )
