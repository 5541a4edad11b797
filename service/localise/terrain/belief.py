"""Whether a DEM may be believed: it must agree with home's and the craft's altitude. `ground_prior` asks."""

from dataclasses import dataclass

import numpy as np

from distloc.filter.ground import GridGround, Ground
from distloc.geometry.earth import EARTH_RADIUS_M
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.config.sections import GroundConfig

# A DEM is at home's altitude where home is, but for its own error (16 m for 90 %), the autopilot's (10 m) and roofs and
# crowns; what is further off has another zero, unit or meaning, and would put a fire as wrong as it is itself.
_OFF_M = 40.0
_AT_HOME_M, _NEAR_M = 200.0, 10_000.0  # where home is looked for: its place is told, or only that it is not far
_ON_GROUND_M = 15.0  # the first position was so near home's altitude: it was home
_RINGS, _SPOKES = 20, 36


@dataclass(frozen=True, slots=True)
class Known:
    """What the autopilot knows of heights: home's and the craft's, which a DEM must agree with, and the geoid's."""

    home_alt_msl_m: float | None
    home_lat_lon_deg: tuple[float, float] | None = None
    craft_enu_m: FloatArray | None = None  # (3,)
    undulation_m: float | None = None


def disbelief(config: GroundConfig, ground: GridGround, frame: LocalFrame, known: Known) -> tuple[str, str]:
    """Why a DEM that was read is not believed, and the line that says it; empty: it is."""
    _, has_origin = ground.heights_m(np.zeros(1), np.zeros(1))
    if not has_origin[0]:
        return "dem_lacks_place", f"{config.path}: no height at {frame.origin[0]:.5f}, {frame.origin[1]:.5f}"
    if known.home_alt_msl_m is not None and (fault := _not_at_home(config, ground, frame, known)):
        return "dem_not_at_home", fault
    if known.craft_enu_m is not None and (fault := under_ground(config, ground, known.craft_enu_m)):
        return "dem_above_craft", fault
    return "", ""


def _not_at_home(config: GroundConfig, ground: GridGround, frame: LocalFrame, known: Known) -> str:
    """Looks for home's altitude at home, or where its place is not known, anywhere near."""
    home_m = known.home_alt_msl_m or 0.0
    centre_enu_m = np.zeros(3)
    radius_m = _AT_HOME_M if abs(frame.origin[2] - home_m) <= _ON_GROUND_M else _NEAR_M
    if known.home_lat_lon_deg is not None:
        centre_enu_m, radius_m = frame.enu_from_geodetic(*known.home_lat_lon_deg, home_m), _AT_HOME_M
    rings_m = np.linspace(0.0, radius_m, _RINGS)[:, None]
    angles_rad = np.linspace(0.0, 2.0 * np.pi, _SPOKES, endpoint=False)
    east_m = (centre_enu_m[0] + rings_m * np.cos(angles_rad)).reshape(-1)
    north_m = (centre_enu_m[1] + rings_m * np.sin(angles_rad)).reshape(-1)
    up_m, is_known = ground.heights_m(east_m, north_m)
    if not is_known.any():
        return ""
    fall_m = (np.square(east_m) + np.square(north_m)) / (2.0 * EARTH_RADIUS_M)
    heights_m = (up_m + fall_m + frame.origin[2])[is_known]
    low_m, high_m = float(heights_m.min()), float(heights_m.max())
    if low_m - _tolerance_m(config) <= home_m <= high_m + _tolerance_m(config):
        return ""
    where = "at home" if radius_m == _AT_HOME_M else f"within {radius_m / 1000.0:.0f} km"
    return (
        f"{config.path}: {low_m:.0f} to {high_m:.0f} m {where}, whose altitude is {home_m:.0f} m: "
        "heights in metres above the sea are needed"
    )


def under_ground(config: GroundConfig, ground: Ground, craft_enu_m: FloatArray) -> str:
    """The line that says that the DEM has the craft under the ground; empty: it has not."""
    if not isinstance(ground, GridGround):
        return ""
    up_m, is_known = ground.heights_m(craft_enu_m[:1], craft_enu_m[1:2])
    under_m = float(up_m[0] - craft_enu_m[2])
    if not is_known[0] or under_m <= _tolerance_m(config):
        return ""
    return f"{config.path}: has the craft {under_m:.0f} m under the ground: heights in metres above the sea are needed"


def _tolerance_m(config: GroundConfig) -> float:
    return max(_OFF_M, 2.0 * config.height_sigma_m)
