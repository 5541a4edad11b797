"""Chooses the ground that the config asks for once the frame's origin is known. The localise stage calls it."""

import logging
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from distloc.filter.ground import FlatGround, GridGround, Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from service.autopilot.autopilot import Autopilot
from service.config.sections import FLAT_SIGMA_M, GroundConfig
from service.localise.terrain.dem import DemError, ground_from_dem

logger = logging.getLogger(__name__)

_HOME_MOVED_M = 5.0  # less is the EKF's drift between two homes of one place
_NAMES: dict[type[Any], str] = {NoGround: "none", FlatGround: "flat", GridGround: "dem"}


class GroundKeeper:
    """Makes the ground once the map's origin is known, and again where origin or home have moved.

    `set_ground` gets it. `ask` runs in the thread that owns the localizer, for it may read files.
    """

    def __init__(self, config: GroundConfig, autopilot: Autopilot, set_ground: Callable[[Ground], None]) -> None:
        self.reasons: Counter[str] = Counter()
        self._config, self._autopilot, self._set_ground = config, autopilot, set_ground
        self._ground: Ground = NoGround()
        self._frame_enu: LocalFrame | None = None
        self._home_alt_msl_m: float | None = None

    def ask(self) -> None:
        """Have the ground made if it is due."""
        frame_enu, home_alt_msl_m = self._autopilot.frame_enu, self._autopilot.home_alt_msl_m
        if self._config.kind == "off" or frame_enu is None:
            return
        if frame_enu is self._frame_enu and not self._has_home_moved(home_alt_msl_m):
            return
        self._frame_enu, self._home_alt_msl_m = frame_enu, home_alt_msl_m
        self._ground = make_ground(self._config, frame_enu, home_alt_msl_m, self.reasons)
        self._set_ground(self._ground)

    def counters(self) -> dict[str, object]:
        """What the status carries: the prior that is used, and why it is not the one asked for."""
        return {"asked": self._config.kind, "used": _NAMES[type(self._ground)], "reasons": dict(self.reasons)}

    def _has_home_moved(self, home_alt_msl_m: float | None) -> bool:
        if home_alt_msl_m is None or self._home_alt_msl_m is None:
            return home_alt_msl_m is not self._home_alt_msl_m
        return abs(home_alt_msl_m - self._home_alt_msl_m) > _HOME_MOVED_M


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
