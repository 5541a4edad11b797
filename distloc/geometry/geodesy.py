"""Local ENU axes about an origin on the WGS84 ellipsoid, by way of ECEF: exact at any range.

Heights are whatever datum the origin's height has; over tens of kilometres the geoid's undulation is a constant.
"""

import math

import numpy as np

from distloc.types import FloatArray

# WGS84 (NIMA TR8350.2): the equator's radius and the flattening
_A_M, _F = 6_378_137.0, 1.0 / 298.257223563
_E2 = _F * (2.0 - _F)
_ROUNDS = 3  # of Bowring's iteration (1976): one is good to a millionth of a second of arc near the ground


def ecef_from_geodetic(lat_deg: float, lon_deg: float, height_m: float) -> FloatArray:
    """Position (3,) from the earth's centre, EPSG:4978. By hand, as PROJ takes 15 MB of the drone's memory."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    across_m = _A_M / math.sqrt(1.0 - _E2 * math.sin(lat) ** 2)
    level_m = (across_m + height_m) * math.cos(lat)
    up_m = ((1.0 - _E2) * across_m + height_m) * math.sin(lat)
    return np.array([level_m * math.cos(lon), level_m * math.sin(lon), up_m])


def geodetic_from_ecef(position_m: FloatArray) -> tuple[float, float, float]:
    """Latitude and longitude in degrees, height in metres; the other way round, to a tenth of a millimetre."""
    x_m, y_m, z_m = position_m.tolist()
    level_m, b_m = math.hypot(x_m, y_m), (1.0 - _F) * _A_M
    reduced = math.atan2(z_m, (1.0 - _F) * level_m)
    for _ in range(_ROUNDS):
        lat = math.atan2(
            z_m + _E2 / (1.0 - _E2) * b_m * math.sin(reduced) ** 3, level_m - _E2 * _A_M * math.cos(reduced) ** 3
        )
        reduced = math.atan2((1.0 - _F) * math.sin(lat), math.cos(lat))
    height_m = level_m * math.cos(lat) + z_m * math.sin(lat) - _A_M * math.sqrt(1.0 - _E2 * math.sin(lat) ** 2)
    return math.degrees(lat), math.degrees(math.atan2(y_m, x_m)), height_m


class LocalFrame:
    """East, north, up in metres about an origin given in degrees and metres.

    Raises ValueError for an origin that is not on the earth.
    """

    def __init__(self, lat_deg: float, lon_deg: float, height_m: float) -> None:
        if not (np.isfinite([lat_deg, lon_deg, height_m]).all() and abs(lat_deg) <= 90 and abs(lon_deg) <= 180):
            raise ValueError(
                f"origin must have |lat| <= 90, |lon| <= 180 and a height, got {lat_deg}, {lon_deg}, {height_m}"
            )
        self.origin = (lat_deg, lon_deg, height_m)
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        self._origin_ecef_m = ecef_from_geodetic(lat_deg, lon_deg, height_m)
        self._R_enu_from_ecef = np.array(
            [
                [-np.sin(lon), np.cos(lon), 0.0],
                [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
                [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
            ]
        )

    def enu_from_geodetic(self, lat_deg: float, lon_deg: float, height_m: float) -> FloatArray:
        """Position (3,) in metres."""
        ecef_m = ecef_from_geodetic(lat_deg, lon_deg, height_m)
        return np.asarray(self._R_enu_from_ecef @ (ecef_m - self._origin_ecef_m))

    def geodetic_from_enu(self, position_enu_m: FloatArray) -> tuple[float, float, float]:
        """Latitude and longitude in degrees, height in metres."""
        return geodetic_from_ecef(self._R_enu_from_ecef.T @ position_enu_m + self._origin_ecef_m)

    def from_other(self, other: "LocalFrame") -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and shift (3,) in metres: `R @ p + shift` is a position p of the other frame in this one."""
        R_enu_from_other = self._R_enu_from_ecef @ other._R_enu_from_ecef.T
        return R_enu_from_other, self._R_enu_from_ecef @ (other._origin_ecef_m - self._origin_ecef_m)
