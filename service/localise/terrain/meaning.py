"""What a GeoTIFF's numbers mean: GDAL's scale and offset, their unit and what they are measured from. Free of I/O."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_FOOT_M, _US_FOOT_M = 0.3048, 1200.0 / 3937.0
_METRES_OF_EPSG = {9001: 1.0, 9002: _FOOT_M, 9003: _US_FOOT_M}  # VerticalUnitsGeoKey
_METRES_OF_NAME = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot", "foot_int"), _FOOT_M),
    **dict.fromkeys(("us survey foot", "us-ft", "ft-us", "us_ft", "ftus", "foot_us", "us_survey_foot"), _US_FOOT_M),
    **{"dm": 0.1, "cm": 0.01, "mm": 0.001},
}
_ELLIPSOIDS = range(5001, 5034)  # GeoTIFF 1.0's vertical codes of ellipsoids; 5030 is WGS84's
_USER_DEFINED = 32767
_ITEM = re.compile(r"<Item\b([^>]*)>([^<]*)</Item>")
_ATTRIBUTE = re.compile(r"(\w+)\s*=\s*\"([^\"]*)\"")
_PAM_BAND = re.compile(r"<PAMRasterBand\b[^>]*band=\"1\"[^>]*>(.*?)</PAMRasterBand>", re.DOTALL)
_PAM_VALUE = re.compile(r"<(Scale|Offset|UnitType)>([^<]*)</\1>")


@dataclass(frozen=True, slots=True)
class Meaning:
    """Metres = number * scale + offset, above the sea or the WGS84 ellipsoid; `is_stated`: the file says how."""

    scale: float = 1.0
    offset_m: float = 0.0
    is_ellipsoidal: bool = False
    is_stated: bool = False


METRES = Meaning()  # above the sea


def stated_in_metadata(text: str) -> dict[str, str]:
    """`scale`, `offset`, `unittype` of the first band, as far as GDAL_METADATA (tag 42112) has them."""
    stated: dict[str, str] = {}
    for attributes, value in _ITEM.findall(text):
        known = {key.lower(): word.lower() for key, word in _ATTRIBUTE.findall(attributes)}
        role = known.get("role") or known.get("name", "")
        if role in ("scale", "offset", "unittype") and known.get("sample", "0") == "0":
            stated[role] = value.strip()
    return stated


def stated_beside(text: str) -> dict[str, str]:
    """The same from GDAL's .aux.xml beside a file."""
    band = _PAM_BAND.search(text)
    return {key.lower(): value.strip() for key, value in _PAM_VALUE.findall(band[1])} if band else {}


def meaning_of(stated: Mapping[str, str], keys: Mapping[str, Any], crs: Any) -> Meaning:
    """From GDAL's items, the GeoTIFF keys and the pyproj CRS; ValueError names what cannot be read as heights."""
    scale, offset = _number("SCALE", stated.get("scale", "1")), _number("OFFSET", stated.get("offset", "0"))
    if scale == 0.0:
        raise ValueError("GDAL's SCALE is 0: a number other than 0 is needed")
    unit_m, is_ellipsoidal = _vertical(keys, crs)
    unit = stated.get("unittype", "").strip().lower()
    if unit:
        if unit not in _METRES_OF_NAME:
            raise ValueError(f"heights in unit {unit!r:.40}: metres or feet are needed")
        unit_m = _METRES_OF_NAME[unit]
    if "VerticalUnitsGeoKey" in keys:
        code = int(keys["VerticalUnitsGeoKey"])
        if code not in _METRES_OF_EPSG:
            raise ValueError(f"heights in unit EPSG:{code}: metres (EPSG:9001) or feet (9002, 9003) are needed")
        if unit and not math.isclose(_METRES_OF_EPSG[code], unit_m, rel_tol=1e-5):
            raise ValueError(f"heights in unit {unit!r:.40} and in EPSG:{code}: one of them is wrong")
        unit_m = _METRES_OF_EPSG[code]
    return Meaning(scale * unit_m, offset * unit_m, is_ellipsoidal, bool(stated.keys() & {"scale", "offset"}))


def _vertical(keys: Mapping[str, Any], crs: Any) -> tuple[float, bool]:
    """Metres a unit and whether heights are above the ellipsoid, by the vertical CRS; above the sea if none is told."""
    code = int(keys.get("VerticalCSTypeGeoKey", 0) or 0)
    if code in _ELLIPSOIDS or "ellipsoid" in str(keys.get("VerticalCitationGeoKey", "")).lower():
        return 1.0, True
    vertical = _crs_of(code) if code not in (0, _USER_DEFINED) else crs
    if vertical is None:
        raise ValueError(f"its vertical CRS is EPSG:{code}, which is not known: heights above the sea are needed")
    if vertical.sub_crs_list:
        vertical = vertical.sub_crs_list[-1]
    axes = [axis for axis in vertical.axis_info if axis.direction.lower() in ("up", "down")]
    if not axes:
        return 1.0, False
    if axes[0].direction.lower() == "down":
        raise ValueError(f"its vertical CRS {vertical.name!r:.60} counts depths: heights are needed")
    return float(axes[0].unit_conversion_factor), "ellipsoid" in axes[0].name.lower()


def _crs_of(code: int) -> Any:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_epsg(code)
    except CRSError:
        return None


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"GDAL's {name} is {text!r:.40}: a number is needed")
    return number
