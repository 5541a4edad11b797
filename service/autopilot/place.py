"""The map's origin, home and the geoid, from what the autopilot says of places; the autopilot calls it. No I/O."""

from typing import Any

import numpy as np

from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray

ORIGIN_APART_M = 500.0  # between two positions in a row, even if seconds were lost in between
MOST_UNDULATION_M = 120.0  # from -106 m south of India to 86 m at New Guinea


class Place:
    """`frame_enu` is None until two valid positions in a row agree, then the same for good."""

    def __init__(self) -> None:
        self.frame_enu: LocalFrame | None = None
        self.geoid_undulation_m: float | None = None
        self.home_lat_lon_deg: tuple[float, float] | None = None
        self._first: tuple[float, float, float] | None = None
        self._home_alt_msl_m: float | None = None
        self._implied_home_alt_msl_m: float | None = None

    @property
    def home_alt_msl_m(self) -> float | None:
        """HOME_POSITION's altitude, else where the last valid position puts home; None before either."""
        return self._home_alt_msl_m if self._home_alt_msl_m is not None else self._implied_home_alt_msl_m

    def gps(self, message: Any) -> None:
        """Take a GPS_RAW_INT: its two heights tell the geoid's."""
        undulation_m = (message.alt_ellipsoid - message.alt) * 1e-3
        if message.alt_ellipsoid != 0 and message.fix_type >= 3 and abs(undulation_m) < MOST_UNDULATION_M:
            self.geoid_undulation_m = undulation_m

    def home(self, message: Any) -> None:
        """Take a HOME_POSITION."""
        self._home_alt_msl_m = message.altitude * 1e-3
        self.home_lat_lon_deg = (message.latitude * 1e-7, message.longitude * 1e-7)

    def position_enu_m(self, message: Any) -> FloatArray | None:
        """Where a valid GLOBAL_POSITION_INT is (3,), once there is an origin."""
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if self.frame_enu is None:
            self.frame_enu = self._first_frame(place)
        if self.frame_enu is None:
            return None
        self._implied_home_alt_msl_m = (message.alt - message.relative_alt) * 1e-3
        return self.frame_enu.enu_from_geodetic(*place)

    def _first_frame(self, place: tuple[float, float, float]) -> LocalFrame | None:
        """Axes at a place that the one before it bears out: one false first position would hold for the whole run."""
        last, self._first = self._first, place
        if last is None:
            return None
        frame_enu = LocalFrame(*last)
        return frame_enu if float(np.linalg.norm(frame_enu.enu_from_geodetic(*place))) <= ORIGIN_APART_M else None
