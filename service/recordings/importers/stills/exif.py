"""A picture's size and what its EXIF says, through Pillow, which decodes no pixel for it."""

import math
import re
import struct
import warnings
from calendar import timegm
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.common.files import FileRefusedError, check_file
from service.recordings.importers.flight import ImportRefusedError
from service.recordings.importers.stills.xmp import MOST_BYTES, properties_of

_FORMATS = ("JPEG", "TIFF", "PNG", "WEBP")  # MPO, of two pictures, goes as JPEG
_MOST_FILE_BYTES = 500_000_000
_IFD0, _EXIF, _GPS = 0, 0x8769, 0x8825
_MAKE, _MODEL, _ORIENTATION = 0x010F, 0x0110, 0x0112
_TIME, _SUBSECOND, _OFFSET = 0x9003, 0x9291, 0x9011
_FOCAL_MM, _FOCAL_35, _ZOOM = 0x920A, 0xA405, 0xA404
_PLANE_X, _PLANE_UNIT = 0xA20E, 0xA210
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}  # inch, centimetre, millimetre
_XMP_TAG = 700
_DATE = re.compile(r"(\d{4})[:-](\d{1,2})[:-](\d{1,2})[ T](\d{1,2}):(\d{2}):(\d{2})")
_ZONE = re.compile(r"([+-])(\d{2}):?(\d{2})")
# What Pillow raises on files that are not as they should be.
_BROKEN = (OSError, ValueError, SyntaxError, LookupError, TypeError, ArithmeticError, AttributeError, struct.error)


@dataclass(frozen=True, slots=True)
class Exif:
    """Degrees, metres, seconds, pixels; NaN, None or "" where not told.

    `local_s` is the picture's own time as if it were UTC's, `zone_s` local minus UTC, `gps_s` the receiver's UTC, in
    whole seconds by many. `alt_ref` is 0 above and 1 below the sea, 2 and 3 the same of the ellipsoid (EXIF 3).
    """

    width: int
    height: int
    make: str = ""
    model: str = ""
    orientation: int = 1
    lat_deg: float = math.nan
    lon_deg: float = math.nan
    alt_m: float = math.nan
    alt_ref: int = 0
    local_s: float | None = None
    has_subseconds: bool = False
    zone_s: float | None = None
    gps_s: float | None = None
    focal_px: float = math.nan
    focal_35_mm: float = math.nan
    zoom: float = math.nan
    xmp: dict[str, str] = field(default_factory=dict)


class NoPictureError(Exception):
    """A file that is no picture of which EXIF can be read: why, in some words."""


def exif_of(path: Path) -> Exif:
    """What a picture says of itself; NoPictureError."""
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise ImportRefusedError("pictures' EXIF needs Pillow: pip install 'distloc[import]'") from error
    try:
        check_file(path, most_bytes=_MOST_FILE_BYTES)
    except FileRefusedError as error:
        raise NoPictureError("too large, or no regular file") from error
    Image.init()  # else only some of the formats below are known
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of odd tags and of large pictures, which are not decoded here
        try:
            with Image.open(path, formats=_FORMATS) as picture:
                tags = picture.getexif()
                ifds = {_IFD0: dict(tags), _EXIF: dict(tags.get_ifd(_EXIF)), _GPS: dict(tags.get_ifd(_GPS))}
                return _read(picture.size, ifds, _packet(picture.info, ifds[_IFD0]))
        except Image.DecompressionBombError as error:
            raise NoPictureError("more pixels than any camera has") from error
        except _BROKEN as error:
            raise NoPictureError("no picture that can be read: JPEG and TIFF are") from error


def _packet(info: Mapping[Any, Any], ifd0: Mapping[int, Any]) -> bytes:
    for found in (info.get("xmp"), info.get("XML:com.adobe.xmp"), ifd0.get(_XMP_TAG)):
        if isinstance(found, bytes):
            return found[:MOST_BYTES]
        if isinstance(found, str):
            return found[:MOST_BYTES].encode()
    return b""


def _read(size: tuple[int, int], ifds: Mapping[int, Mapping[int, Any]], packet: bytes) -> Exif:
    ifd0, exif, gps = ifds[_IFD0], ifds[_EXIF], ifds[_GPS]
    orientation: Any = ifd0.get(_ORIENTATION)
    local_s, has_subseconds = _local_s(exif)
    ref = gps.get(5, 0)
    ref = ref[0] if isinstance(ref, bytes) and ref else ref
    alt_m = _number(gps.get(6))
    return Exif(
        *size,
        make=_text(ifd0.get(_MAKE)),
        model=_text(ifd0.get(_MODEL)),
        orientation=int(orientation) if orientation in range(1, 9) else 1,
        lat_deg=_degrees(gps.get(2), gps.get(1), "NS", 90.0),
        lon_deg=_degrees(gps.get(4), gps.get(3), "EW", 180.0),
        alt_m=-alt_m if ref in (1, 3) else alt_m,
        alt_ref=ref if ref in (0, 1, 2, 3) else 0,
        local_s=local_s,
        has_subseconds=has_subseconds,
        zone_s=_zone_s(exif.get(_OFFSET)),
        gps_s=_gps_s(gps),
        focal_px=_focal_px(exif),
        focal_35_mm=_number(exif.get(_FOCAL_35)),
        zoom=_number(exif.get(_ZOOM)),
        xmp=properties_of(packet) if packet else {},
    )


def _number(value: Any) -> float:
    """NaN for what is no finite number, as a fraction by zero is none."""
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return math.nan
    return number if math.isfinite(number) else math.nan


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    return value.strip("\0 ")[:100] if isinstance(value, str) else ""


def _degrees(parts: Any, ref: Any, signs: str, most: float) -> float:
    """Of degrees, minutes, seconds and a letter; NaN where the letter lacks: half the earth would be the other one."""
    letter = _text(ref).upper()[:1]
    if not isinstance(parts, (tuple, list)) or not 1 <= len(parts) <= 3 or letter not in signs or not letter:
        return math.nan
    degrees = sum(_number(part) / 60.0**power for power, part in enumerate(parts))
    return (degrees if letter == signs[0] else -degrees) if 0.0 <= degrees <= most else math.nan


def _local_s(exif: Mapping[int, Any]) -> tuple[float | None, bool]:
    found = _DATE.match(_text(exif.get(_TIME)))
    if found is None or (whole_s := _seconds(*(int(one) for one in found.groups()))) is None:
        return None, False
    digits = _text(exif.get(_SUBSECOND))
    has_subseconds = digits.isascii() and digits.isdigit()
    return whole_s + (float(f"0.{digits[:9]}") if has_subseconds else 0.0), has_subseconds


def _zone_s(value: Any) -> float | None:
    found = _ZONE.match(_text(value))
    if found is None:
        return None
    size_s = int(found.group(2)) * 3600 + int(found.group(3)) * 60
    return float(size_s if found.group(1) == "+" else -size_s)


def _gps_s(gps: Mapping[int, Any]) -> float | None:
    date = re.match(r"(\d{4})[:-](\d{1,2})[:-](\d{1,2})", _text(gps.get(29)))
    clock = gps.get(7)
    if date is None or not isinstance(clock, (tuple, list)) or len(clock) != 3:
        return None
    hours, minutes, seconds = (_number(one) for one in clock)
    year, month, day = (int(one) for one in date.groups())
    day_s = _seconds(year, month, day, 0, 0, 0)
    if day_s is None or not (0.0 <= hours < 24.0 and 0.0 <= minutes < 60.0 and 0.0 <= seconds < 61.0):
        return None
    return day_s + hours * 3600.0 + minutes * 60.0 + seconds


def _seconds(year: int, month: int, day: int, hour: int, minute: int, second: int) -> float | None:
    if not (1990 <= year < 2200 and 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 61):
        return None
    return float(timegm((year, month, day, hour, minute, second)))


def _focal_px(exif: Mapping[int, Any]) -> float:
    """By the focal length and the sensor's pixels in each inch, centimetre or millimetre."""
    unit = exif.get(_PLANE_UNIT)
    unit_mm = _UNIT_MM.get(unit if isinstance(unit, int) else 0, math.nan)
    return _number(exif.get(_FOCAL_MM)) * _number(exif.get(_PLANE_X)) / unit_mm
