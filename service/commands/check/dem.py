"""The doctor's look at the DEM: its files are read to their ends and held against home's and the craft's altitude."""

import time
from pathlib import Path

import numpy as np

from distloc.filter.ground import GridGround
from service.autopilot.autopilot import Autopilot
from service.commands.check.finding import Finding, fail, ok, warn
from service.config.sections import GroundConfig
from service.localise.ground_prior import Told, known_of, make_ground
from service.localise.terrain.dem import DemError, open_dem
from service.localise.terrain.tile import Tile

_READ_S = 20.0  # a folder may hold a continent
_MEND = "give ground.path DEM files that can be read"
_DISBELIEF_MEND = "give ground.path a DEM with heights in metres above the sea, or correct the autopilot's home"


def check_dem(config: GroundConfig) -> list[Finding]:
    """What the files are worth by themselves; blocks while they are read."""
    passed_over: list[str] = []
    try:
        tiles = open_dem(Path(config.path), passed_over)
    except DemError as error:
        return [fail("ground", str(error), _MEND)]
    end_s, read = time.monotonic() + _READ_S, 0
    for tile in tiles:
        try:
            read += _read_through(tile, end_s)
        except DemError as error:
            if len(tiles) == 1:
                return [fail("ground", str(error), _MEND)]
            passed_over.append(str(error))
        if time.monotonic() > end_s:
            break
    findings = [warn("ground", f"passed over: {line}", "mend it, or take it out of the folder") for line in passed_over]
    if not read:
        return [*findings, fail("ground", f"{config.path}: no DEM file that can be read", _MEND)]
    over = sum(tile.meaning.is_ellipsoidal for tile in tiles)
    said = f"{read} DEM file{'s' * (read > 1)} in {config.path}"
    said += f", {over} over the ellipsoid: the autopilot's GPS must tell the geoid" if over else ""
    return [ok("ground", said), *findings]


def _read_through(tile: Tile, end_s: float) -> bool:
    """Whether something could be read, block by block, until the time is up; DemError names the first that can't."""
    number = -1
    for number in range(tile.raster.count):
        tile.raster.read(*divmod(number, tile.raster.across))
        if time.monotonic() > end_s:
            break
    return number >= 0


def check_dem_there(config: GroundConfig, autopilot: Autopilot) -> list[Finding]:
    """Whether the service would believe the DEM where the craft is now; nothing before there is a position."""
    frame_enu = autopilot.frame_enu
    if config.kind != "dem" or frame_enu is None:
        return []
    told = Told()
    ground = make_ground(config, frame_enu, autopilot.place.home_alt_msl_m, told, known_of(autopilot, np.zeros(3)))
    if isinstance(ground, GridGround):
        return [ok("ground", "the DEM agrees with home's and the craft's altitude")]
    return [fail("ground", f"{', '.join(told.reasons)}: {told.detail}", _DISBELIEF_MEND)]
