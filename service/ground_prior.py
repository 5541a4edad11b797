"""Chooses the ground that the config asks for once the frame's origin is known. The composition root calls it."""

import logging
from collections import Counter
from pathlib import Path

import numpy as np

from distloc.geodesy import LocalFrame
from distloc.ground import FlatGround, Ground, NoGround
from service.config import FLAT_SIGMA_M, GroundConfig
from service.dem import DemError, ground_from_dem

logger = logging.getLogger(__name__)


def make_ground(
    config: GroundConfig, frame: LocalFrame, home_alt_msl_m: float | None, counters: Counter[str]
) -> Ground:
    """The ground prior; what had to be left is counted under its reason.

    `frame`'s height is above the sea. A DEM without a height at the origin ("dem_lacks_place") or that can't be read
    ("dem_unreadable") falls back to flat at home's altitude; flat without that ("no_home_altitude") knows nothing.
    Reading a DEM takes a second or so: not on the event loop. `open_dem` says at start-up whether it will do.
    """
    if config.kind == "off":
        return NoGround()
    if config.kind == "flat":
        return _flat(config.height_sigma_m, frame, home_alt_msl_m, counters)
    try:
        ground = ground_from_dem(Path(config.path), frame, config.height_sigma_m)
    except DemError as error:
        reason, detail = "dem_unreadable", str(error)
    else:
        _, known = ground.heights_m(np.zeros(1), np.zeros(1))
        if known[0]:
            return ground
        reason, detail = "dem_lacks_place", f"{config.path}: no height at {frame.origin[0]:.5f}, {frame.origin[1]:.5f}"
    counters[reason] += 1
    logger.warning("ground: %s (%s); taken as flat at home's altitude", reason, detail)
    return _flat(max(config.height_sigma_m, FLAT_SIGMA_M), frame, home_alt_msl_m, counters)


def _flat(sigma_m: float, frame: LocalFrame, home_alt_msl_m: float | None, counters: Counter[str]) -> Ground:
    if home_alt_msl_m is None or not np.isfinite(home_alt_msl_m):
        counters["no_home_altitude"] += 1
        logger.warning("ground: no_home_altitude; no prior from the ground")
        return NoGround()
    return FlatGround(home_alt_msl_m - frame.origin[2], sigma_m)
