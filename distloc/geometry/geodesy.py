"""Local ENU axes about an origin on the WGS84 ellipsoid, by way of ECEF: exact at any range.

Heights are whatever datum the origin's height has; over tens of kilometres the geoid's undulation is a constant.
"""

import numpy as np
from pyproj import Transformer
from pyproj.enums import TransformDirection

from distloc.types import FloatArray

# EPSG:4979 to EPSG:4978 without PROJ's database of all systems, which costs a megabyte and more
_ECEF_FROM_GEODETIC = (
    "+proj=pipeline +step +proj=axisswap +order=2,1 +step +proj=unitconvert +xy_in=deg +xy_out=rad "
    "+step +proj=cart +ellps=WGS84"
)


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
        self._ecef_from_geodetic = Transformer.from_pipeline(_ECEF_FROM_GEODETIC)
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
        x_m, y_m, z_m = (float(value) for value in ecef_m)
        lat_deg, lon_deg, height_m = self._ecef_from_geodetic.transform(
            x_m, y_m, z_m, direction=TransformDirection.INVERSE
        )
        return float(lat_deg), float(lon_deg), float(height_m)

    def from_other(self, other: "LocalFrame") -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and shift (3,) in metres: `R @ p + shift` is a position p of the other frame in this one."""
        R_enu_from_other = self._R_enu_from_ecef @ other._R_enu_from_ecef.T
        return R_enu_from_other, self._R_enu_from_ecef @ (other._origin_ecef_m - self._origin_ecef_m)
