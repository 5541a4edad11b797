"""Chooses the ground that the config asks for once the frame's origin is known. The localise stage calls it."""

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from distloc.filter.ground import FlatGround, GridGround, Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.autopilot.autopilot import Autopilot
from service.config.sections import FLAT_SIGMA_M, GroundConfig
from service.localise.terrain.belief import Known, disbelief, under_ground
from service.localise.terrain.dem import DemError, GeoidUnknownError, ground_from_dem

logger = logging.getLogger(__name__)

_HOME_MOVED_M = 5.0  # less is the EKF's drift between two homes of one place
_NAMES: dict[type[Any], str] = {NoGround: "none", FlatGround: "flat", GridGround: "dem"}


@dataclass(slots=True)
class Told:
    """What the status says of the ground: reasons why it is not the one asked for, and lines that name files."""

    reasons: Counter[str] = field(default_factory=Counter)
    files: list[str] = field(default_factory=list)
    detail: str = ""  # of the last reason


class GroundKeeper:
    """Makes the ground once the map's origin is known, and again where origin or home have moved.

    `set_ground` gets it. `ask` runs in the thread that owns the localizer, for it may read files.
    """

    def __init__(self, config: GroundConfig, autopilot: Autopilot, set_ground: Callable[[Ground], None]) -> None:
        self._told = Told()
        self._config, self._autopilot, self._set_ground = config, autopilot, set_ground
        self._ground: Ground = NoGround()
        self._frame_enu: LocalFrame | None = None
        self._home_alt_msl_m: float | None = None
        self._waits_for_geoid = False

    @property
    def reasons(self) -> Counter[str]:
        """Why the ground is not the one asked for."""
        return self._told.reasons

    def ask(self, craft_enu_m: FloatArray | None = None) -> None:
        """Have the ground made if it is due, and given up where the craft (3,) is under it."""
        frame_enu, home_alt_msl_m = self._autopilot.frame_enu, self._autopilot.place.home_alt_msl_m
        if self._config.kind == "off" or frame_enu is None:
            return
        if frame_enu is not self._frame_enu or self._has_home_moved(home_alt_msl_m) or self._has_geoid_come():
            self._frame_enu, self._home_alt_msl_m = frame_enu, home_alt_msl_m
            self._told.files.clear()
            waited = self.reasons["dem_geoid_unknown"]
            self._use(
                make_ground(self._config, frame_enu, home_alt_msl_m, self._told, known_of(self._autopilot, craft_enu_m))
            )
            self._waits_for_geoid = self.reasons["dem_geoid_unknown"] > waited
        elif craft_enu_m is not None and (fault := under_ground(self._config, self._ground, craft_enu_m)):
            self._use(_fallen_back(self._config, frame_enu, home_alt_msl_m, self._told, "dem_above_craft", fault))

    def counters(self) -> dict[str, object]:
        """What the status carries: the prior that is used, and why it is not the one asked for."""
        told: dict[str, object] = {"asked": self._config.kind, "used": _NAMES[type(self._ground)]}
        told["reasons"] = dict(self._told.reasons)
        return told | ({"files": list(self._told.files)} if self._told.files else {})

    def _use(self, ground: Ground) -> None:
        self._ground = ground
        self._set_ground(ground)

    def _has_geoid_come(self) -> bool:
        return self._waits_for_geoid and _undulation_m(self._autopilot) is not None

    def _has_home_moved(self, home_alt_msl_m: float | None) -> bool:
        if home_alt_msl_m is None or self._home_alt_msl_m is None:
            return home_alt_msl_m is not self._home_alt_msl_m
        return abs(home_alt_msl_m - self._home_alt_msl_m) > _HOME_MOVED_M


def known_of(autopilot: Autopilot, craft_enu_m: FloatArray | None) -> Known:
    """What an autopilot has told by now; `craft_enu_m` is (3,)."""
    place = autopilot.place
    return Known(place.home_alt_msl_m, place.home_lat_lon_deg, craft_enu_m, _undulation_m(autopilot))


def _undulation_m(autopilot: Autopilot) -> float | None:
    """The geoid's height over the ellipsoid; a receiver that knows none gives its two heights equal."""
    return autopilot.place.geoid_undulation_m or None


def make_ground(
    config: GroundConfig,
    frame: LocalFrame,
    home_alt_msl_m: float | None,
    told: Told | Counter[str],
    known: Known | None = None,
) -> Ground:
    """The ground prior; what had to be left is counted under its reason.

    `frame`'s height is above the sea. A DEM without a height at the origin ("dem_lacks_place"), one that can't be read
    ("dem_unreadable"), over the ellipsoid while nobody tells the geoid ("dem_geoid_unknown"), or against home's
    ("dem_not_at_home") or the craft's altitude ("dem_above_craft") falls back to flat at home's altitude; flat without
    that ("no_home_altitude") knows nothing. Reading a DEM takes a second or so: not on the event loop. `open_dem` says
    at start-up whether it will do.
    """
    told = told if isinstance(told, Told) else Told(told)
    known = known or Known(None)
    if config.kind == "off":
        return NoGround()
    if config.kind == "flat":
        return _flat(config.height_sigma_m, frame, home_alt_msl_m, told.reasons)
    try:
        ground = ground_from_dem(
            Path(config.path), frame, config.height_sigma_m, undulation_m=known.undulation_m, passed_over=told.files
        )
    except DemError as error:
        reason, detail = "dem_unreadable", str(error)
        if isinstance(error, GeoidUnknownError):
            reason = "dem_geoid_unknown"
        if detail not in told.files:
            told.files.append(detail)
    else:
        for line in told.files:
            logger.warning("ground: passed over: %s", line)
        reason, detail = disbelief(config, ground, frame, known)
        if not reason:
            return ground
    return _fallen_back(config, frame, home_alt_msl_m, told, reason, detail)


def _fallen_back(
    config: GroundConfig, frame: LocalFrame, home_alt_msl_m: float | None, told: Told, reason: str, detail: str
) -> Ground:
    told.reasons[reason] += 1
    told.detail = detail
    if reason in ("dem_not_at_home", "dem_above_craft"):
        told.files.append(detail)
    logger.warning("ground: %s (%s); taken as flat at home's altitude", reason, detail)
    return _flat(max(config.height_sigma_m, FLAT_SIGMA_M), frame, home_alt_msl_m, told.reasons)


def _flat(sigma_m: float, frame: LocalFrame, home_alt_msl_m: float | None, counters: Counter[str]) -> Ground:
    if home_alt_msl_m is None or not np.isfinite(home_alt_msl_m):
        counters["no_home_altitude"] += 1
        logger.warning("ground: no_home_altitude; no prior from the ground")
        return NoGround()
    return FlatGround(home_alt_msl_m - frame.origin[2], sigma_m)
