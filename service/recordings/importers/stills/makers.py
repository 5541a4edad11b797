"""Which name of whose XMP tells what: a camera's angles, its place and height, its lens. Free of I/O.

All angles are degrees from north and the horizon, in the order yaw, pitch, roll, unless said; -90 looks down.
"""

import math
from dataclasses import dataclass

import numpy as np

from distloc.geometry.rotations import euler_from_matrix, matrix_from_euler
from distloc.types import FloatArray
from service.recordings.importers.assumptions import EARTH_M
from service.recordings.importers.stills.exif import Exif

_DRONES = ("drone-dji", "drone", "drone-autel", "drone-flir", "drone-teal")  # DJI's names under other prefixes
_PIX4D = ("Camera", "camera", "pix4d")
_NADIR_FROM_LEVEL = matrix_from_euler(0.0, -math.pi / 2, 0.0)  # of Pix4D's axes: x is the picture's top
_LEAST_PIX4D_PITCH_DEG = -20.0  # looking back under the craft: more likely from the horizon, by a writer of his own
_RTK_FIXED, _RTK_FLOAT_FROM = 50, 32
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)


@dataclass(frozen=True, slots=True)
class Told:
    """Of one picture; NaN where it is not told.

    `camera_deg` and `craft_deg` are (3,) yaw, pitch, roll; `from_pix4d`: the camera's are of Pix4D's names, whose zero
    not all writers keep to; `is_spoilt`: one is there and is no number. `apart_m`: the place of EXIF from that of XMP,
    NaN where one of them lacks. `focal_px` is at the picture's size; `is_calibrated`: it is a calibration's.
    """

    lat_deg: float
    lon_deg: float
    alt_msl_m: float
    alt_ellipsoid_m: float
    above_home_m: float
    camera_deg: FloatArray
    craft_deg: FloatArray
    from_pix4d: bool
    focal_px: float
    is_calibrated: bool
    fix_type: int
    h_acc_m: float
    is_upside_down: bool
    is_spoilt: bool
    apart_m: float


def told_by(exif: Exif) -> Told:
    """What a picture's XMP and EXIF tell, the XMP first: it has more digits."""
    xmp = exif.xmp
    lat = _first(xmp, [*_of_drones("GpsLatitude"), *_of_drones("Latitude"), "drone-skydio:Latitude"])
    lon = _first(
        xmp,
        [
            *_of_drones("GpsLongitude"),
            *_of_drones("GpsLongtitude"),  # as DJI's and Autel's firmware spelt it
            *_of_drones("Longitude"),
            "drone-skydio:Longitude",
        ],
    )
    apart_m = _apart_m(lat, lon, exif)
    if not (math.isfinite(lat + lon) and abs(lat) <= 90.0 and abs(lon) <= 180.0) or (lat == 0.0 and lon == 0.0):
        lat, lon = exif.lat_deg, exif.lon_deg
    msl, ellipsoid = _heights(exif)
    camera, from_pix4d = _camera_deg(xmp)
    focal_px, is_calibrated = _focal_px(exif)
    fix_type, h_acc = _fix(xmp)
    return Told(
        lat_deg=lat,
        lon_deg=lon,
        alt_msl_m=msl,
        alt_ellipsoid_m=ellipsoid,
        above_home_m=_first(
            xmp,
            [
                *_of_drones("RelativeAltitude"),
                "drone-skydio:RelativeAltitude",
                "drone-parrot:RelativeAltitude",
                "FLIR:MAVRelativeAltitude",
                *(f"{prefix}:AboveGroundAltitude" for prefix in _PIX4D),
            ],
        ),
        camera_deg=camera,
        craft_deg=_angles(xmp, [*_of_drones("Flight*Degree"), "drone-parrot:Drone*Degree", "FLIR:MAV*"]),
        from_pix4d=from_pix4d,
        focal_px=focal_px,
        is_calibrated=is_calibrated,
        fix_type=fix_type,
        h_acc_m=h_acc,
        is_spoilt=not np.isfinite(camera).all() and any(_is_spoilt(*one) for one in xmp.items()),
        apart_m=apart_m,
        is_upside_down="1" in (xmp.get("drone-dji:CamReverse"), xmp.get("drone-dji:GimbalReverse")),
    )


def _is_spoilt(name: str, text: str) -> bool:
    prefix, _, key = name.partition(":")
    is_angle = key.endswith(("YawDegree", "PitchDegree", "RollDegree")) and not key.startswith("Flight")
    is_angle |= prefix in _PIX4D and key in ("Yaw", "Pitch", "Roll")
    return is_angle and not math.isfinite(number_of(text))


def _apart_m(lat_deg: float, lon_deg: float, exif: Exif) -> float:
    """From EXIF's place; NaN where one of them is none."""
    places = ((lat_deg, lon_deg), (exif.lat_deg, exif.lon_deg))
    if not all(math.isfinite(lat + lon) and (lat or lon) for lat, lon in places):
        return math.nan
    up, other = (
        np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        for lat, lon in np.radians(places)
    )
    return float(EARTH_M * math.atan2(np.linalg.norm(np.cross(up, other)), up @ other))


def number_of(text: str | None) -> float:
    """A number as XMP has it: +12.3, 12,3 or 1230/100; NaN for anything else."""
    try:
        above, _, below = (text or "").partition("/")
        value = float(above.replace(",", ".")) / float(below or 1.0)
    except (ValueError, ZeroDivisionError, OverflowError):
        return math.nan
    return value if math.isfinite(value) else math.nan


def _first(xmp: dict[str, str], names: list[str]) -> float:
    return next((value for name in names if math.isfinite(value := number_of(xmp.get(name)))), math.nan)


def _of_drones(name: str) -> list[str]:
    return [f"{prefix}:{name}" for prefix in _DRONES]


def _angles(xmp: dict[str, str], patterns: list[str]) -> FloatArray:
    """(3,) of the first name of which yaw and pitch are there; a roll that lacks is 0."""
    for pattern in patterns:
        yaw, pitch, roll = (number_of(xmp.get(pattern.replace("*", name))) for name in ("Yaw", "Pitch", "Roll"))
        if math.isfinite(yaw + pitch) and max(abs(yaw), abs(pitch)) <= 360.0:
            return np.array([yaw, pitch, roll if abs(roll) <= 360.0 else 0.0])
    return np.full(3, math.nan)


def _camera_deg(xmp: dict[str, str]) -> tuple[FloatArray, bool]:
    """Angles from the horizon, and whether Pix4D's names told them; NaN where those cannot mean Pix4D's zero."""
    own = _angles(
        xmp,
        [
            *_of_drones("Gimbal*Degree"),
            "drone-skydio:CameraOrientationNED:*",
            "drone-parrot:Camera*Degree",
            *_of_drones("Camera*Degree"),
        ],
    )
    if np.isfinite(own).all():
        return own, False
    pix4d = _angles(xmp, [f"{prefix}:*" for prefix in _PIX4D])
    if not np.isfinite(pix4d).all() or any(name.startswith("FLIR:MAV") for name in xmp):
        return np.full(3, math.nan), False  # a FLIR in a craft has its angles from the craft's nose
    if pix4d[1] < _LEAST_PIX4D_PITCH_DEG:
        return np.full(3, math.nan), True
    return level_from_nadir(pix4d), True


def level_from_nadir(angles_deg: FloatArray) -> FloatArray:
    """Yaw, pitch, roll (3,) of a camera from the horizon, of Pix4D's, whose zero looks down, its top to the north."""
    return np.degrees(euler_from_matrix(matrix_from_euler(*np.radians(angles_deg)) @ _NADIR_FROM_LEVEL))


def _heights(exif: Exif) -> tuple[float, float]:
    """Over the sea and over the ellipsoid: an RTK's and Skydio's are the ellipsoid's, whatever EXIF's letter says."""
    xmp = exif.xmp
    absolute = _first(xmp, [*_of_drones("AbsoluteAltitude"), "drone-skydio:AbsoluteAltitude"])
    alt_m = absolute if math.isfinite(absolute) else exif.alt_m
    is_rtk = xmp.get("drone-dji:AltitudeType", "").lower().startswith("rtk") or _fix(xmp)[0] >= 5
    is_skydio = exif.make.lower().startswith("skydio") or any(name.startswith("drone-skydio:") for name in xmp)
    is_ellipsoid = is_rtk or is_skydio or (not math.isfinite(absolute) and exif.alt_ref in (2, 3))
    return (math.nan, alt_m) if is_ellipsoid else (alt_m, math.nan)


def _fix(xmp: dict[str, str]) -> tuple[int, float]:
    """MAVLink's fix type, and the horizontal sigma where the receiver told it."""
    flag = number_of(xmp.get("drone-dji:RtkFlag"))
    told_m = math.hypot(number_of(xmp.get("drone-dji:RtkStdLat")), number_of(xmp.get("drone-dji:RtkStdLon")))
    kind = 6 if flag == _RTK_FIXED else 5 if flag >= _RTK_FLOAT_FROM else 3
    accuracy = _first(xmp, ["drone-skydio:GpsHorizontalAccuracy", *(f"{prefix}:GPSXYAccuracy" for prefix in _PIX4D)])
    return kind, told_m if math.isfinite(told_m) and told_m > 0.0 else accuracy


def _focal_px(exif: Exif) -> tuple[float, bool]:
    """A calibration's where it is one of this picture, else the sensor's, else by the 35 mm equivalent's diagonal."""
    xmp = exif.xmp
    diagonal_px = math.hypot(exif.width, exif.height)
    zoom = exif.zoom if exif.zoom > 1.0 else 1.0
    by_35 = exif.focal_35_mm * diagonal_px / _FULL_FRAME_DIAGONAL_MM * zoom
    dewarp = xmp.get("drone-dji:DewarpData", "").partition(";")[2].split(",")
    calibrated = next(
        (
            one
            for one in (
                number_of(dewarp[0]),
                number_of(xmp.get("drone-dji:CalibratedFocalLength")),
                number_of(xmp.get("drone-skydio:CalibratedFocalLength:X")),
            )
            if _is_lens(one, exif.width) and not abs(math.log(one / by_35 if by_35 > 0.0 else 1.0)) > 0.2
        ),
        math.nan,
    )
    if math.isfinite(calibrated):
        return calibrated, True
    found = [one for one in (exif.focal_px, by_35) if _is_lens(one, exif.width)]
    if len(found) == 2 and abs(math.log(found[0] / found[1])) > 0.2:
        return found[1], False  # many write the sensor's pixels before they were binned, or for another picture
    return (found[0], False) if found else (math.nan, False)


def _is_lens(focal_px: float, width: int) -> bool:
    return math.isfinite(focal_px) and 0.15 * width < focal_px < 100.0 * width
