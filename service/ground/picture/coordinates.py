"""A place as a crew reads it out: degrees and decimal minutes first (WGS 84), then decimal, MGRS and UTM."""

import msgspec
from mgrs import MGRS
from mgrs.core import MGRSError

_GRID = MGRS()
_SOUTHMOST_DEG, _NORTHMOST_DEG = -80.0, 84.0  # of UTM


class PlaceTexts(msgspec.Struct, frozen=True):
    """One place, four ways; to a metre; MGRS and UTM are empty beyond 80 S and 84 N."""

    minutes: str
    decimal: str
    mgrs: str
    utm: str


def place_texts(lat_deg: float, lon_deg: float) -> PlaceTexts:
    """The texts of a place in degrees."""
    mgrs = utm = ""
    if _SOUTHMOST_DEG <= lat_deg < _NORTHMOST_DEG:
        mgrs, utm = _grids(lat_deg, lon_deg)
    return PlaceTexts(
        f"{_minutes(lat_deg, 'N', 'S', 2)}  {_minutes(lon_deg, 'E', 'W', 3)}",
        f"{lat_deg:.5f}, {lon_deg:.5f}",
        mgrs,
        utm,
    )


def _grids(lat_deg: float, lon_deg: float) -> tuple[str, str]:
    """MGRS and UTM; empty where the library finds none, as within a millimetre south of the equator."""
    try:
        grid = str(_GRID.toMGRS(lat_deg, lon_deg))  # 32TMT7025452774
        _, _, east_m, north_m = _GRID.MGRSToUTM(grid)
    except MGRSError:
        return "", ""
    mgrs = f"{grid[:-12]} {grid[-12:-10]} {grid[-10:-5]} {grid[-5:]}"
    return mgrs, f"{grid[:-12]} {int(east_m)} E {int(north_m)} N"  # the band's letter tells north from south


def _minutes(angle_deg: float, positive: str, negative: str, digits: int) -> str:
    """47° 25.664' N, to a thousandth of a minute, 2 m: rounded as one number, so that there are no 60.000'."""
    thousandths = round(abs(angle_deg) * 60_000.0)
    degrees, rest = divmod(thousandths, 60_000)
    letter = positive if angle_deg >= 0.0 or thousandths == 0 else negative
    return f"{degrees:0{digits}d}° {rest / 1000.0:06.3f}' {letter}"
