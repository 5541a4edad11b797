"""Local ENU axes about an origin on the WGS84 ellipsoid, by way of ECEF: exact at any range.

Heights are whatever datum the origin's height has; over tens of kilometres the geoid's undulation is a constant.
"""

import numpy as np
from pyproj import Transformer

from distloc.types import FloatArray


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
        self._ecef_from_geodetic = Transformer.from_crs("EPSG:4979", "EPSG:4978")
        self._geodetic_from_ecef = Transformer.from_crs("EPSG:4978", "EPSG:4979")
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        self._origin_ecef_m = np.array(self._ecef_from_geodetic.transform(lat_deg, lon_deg, height_m))
        self._R_enu_from_ecef = np.array(
            [
                [-np.sin(lon), np.cos(lon), 0.0],
                [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
                [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
            ]
        )

    def enu_from_geodetic(self, lat_deg: float, lon_deg: float, height_m: float) -> FloatArray:
        """Position (3,) in metres."""
        ecef_m = np.array(self._ecef_from_geodetic.transform(lat_deg, lon_deg, height_m))
        return np.asarray(self._R_enu_from_ecef @ (ecef_m - self._origin_ecef_m))

    def geodetic_from_enu(self, position_enu_m: FloatArray) -> tuple[float, float, float]:
        """Latitude and longitude in degrees, height in metres."""
        ecef_m = self._R_enu_from_ecef.T @ position_enu_m + self._origin_ecef_m
        lat_deg, lon_deg, height_m = self._geodetic_from_ecef.transform(*ecef_m)
        return float(lat_deg), float(lon_deg), float(height_m)

    def from_other(self, other: "LocalFrame") -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and shift (3,) in metres: `R @ p + shift` is a position p of the other frame in this one."""
        R_enu_from_other = self._R_enu_from_ecef @ other._R_enu_from_ecef.T
        return R_enu_from_other, self._R_enu_from_ecef @ (other._origin_ecef_m - self._origin_ecef_m)
