"""What the commands on tables of sightings are told, and how they read: the rows, and the ground under them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.batch.locate import MOST_SIGHTINGS
from distloc.filter.ground import FlatGround, Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from service.config.load import load_config
from service.config.sections import DEM_SIGMA_M, FLAT_SIGMA_M
from service.localise.terrain.dem import ground_from_dem
from service.recordings.sightings.reading import SightingsError, Table, read_table
from service.recordings.sightings.rows import Sightings, sightings_of

_MOST_FAULTS = 12
_DEM_HALF_WIDTH_M = 60_000.0
_LEAST_RANGE_M = 10.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the command line asks for."""

    config: Path | None = None
    out: Path | None = None
    dem: Path | None = None
    ground_m: float | None = None
    ground_sigma_m: float | None = None
    geoid_m: float | None = None
    home: tuple[float, float] | None = None
    max_range_km: float = 60.0
    smoke_offset_m: float | None = None

    @property
    def range_m(self) -> tuple[float, float]:
        """From where to where targets are looked for."""
        return _LEAST_RANGE_M, 1e3 * self.max_range_km


def read_sightings(
    paths: Sequence[Path], wanted: Wanted, warn: Callable[[str], None], also: frozenset[str] = frozenset()
) -> tuple[list[Table], Sightings]:
    """Files' tables and what their rows say, what can't be used told of; `also` are columns that the caller reads.

    SightingsError where no row can be used, or there are too many.
    """
    config = load_config(wanted.config) if wanted.config else None
    tables = [read_table(path) for path in paths]
    found = sightings_of(tables, config, wanted.geoid_m, wanted.home, also, wanted.smoke_offset_m)
    if len(found.sightings) > MOST_SIGHTINGS:
        raise SightingsError(
            f"{paths[0]}: {len(found.sightings)} sightings: at most {MOST_SIGHTINGS} are taken at once"
        )
    for line in found.faults[:_MOST_FAULTS]:
        warn(f"not used: {line}")
    if len(found.faults) > _MOST_FAULTS:
        warn(f"not used: {len(found.faults) - _MOST_FAULTS} more rows that can't be read")
    for line in found.notes:
        warn(f"note: {line}")
    return tables, found


def ground_of(wanted: Wanted, found: Sightings, warn: Callable[[str], None]) -> Callable[[LocalFrame], Ground] | None:
    """The ground that is asked for, in a frame; None without one. What looks wrong of it is told of."""
    if wanted.dem is not None:
        dem, sigma_m = wanted.dem, wanted.ground_sigma_m or DEM_SIGMA_M

        def of_dem(frame: LocalFrame) -> Ground:
            passed_over: list[str] = []
            ground = ground_from_dem(
                dem, frame, sigma_m, _DEM_HALF_WIDTH_M, undulation_m=wanted.geoid_m, passed_over=passed_over
            )
            for line in passed_over:
                warn(f"note: passed over: {line}")
            if not _knows_a_camera(ground, frame, found):
                warn(f"note: {dem}: has no height at any camera: not used; the tiles of this place are needed")
                return NoGround()
            _tell_buried(ground, frame, found, warn)
            return ground

        return of_dem
    if wanted.ground_m is not None:
        height_m, sigma_m = wanted.ground_m, wanted.ground_sigma_m or FLAT_SIGMA_M
        if wanted.ground_sigma_m:  # whoever says how sure it is means wherever a target may be
            return lambda frame: FlatGround(height_m - frame.origin[2], sigma_m, slope=0.0)
        return lambda frame: FlatGround(height_m - frame.origin[2], sigma_m)
    return None


def _knows_a_camera(ground: Ground, frame: LocalFrame, found: Sightings) -> bool:
    places = {(one.lat_deg, one.lon_deg, one.height_m) for one in found.sightings}
    at = np.array([frame.enu_from_geodetic(*place) for place in places])
    return bool(ground.heights_m(at[:, 0], at[:, 1])[1].any())


def _tell_buried(ground: Ground, frame: LocalFrame, found: Sightings, warn: Callable[[str], None]) -> None:
    """A camera under the DEM's ground, or kilometres over it where feet would be right, is told of."""
    places = {(one.lat_deg, one.lon_deg, one.height_m): i for i, one in enumerate(found.sightings)}
    at = np.array([frame.enu_from_geodetic(*place) for place in places])
    up_m, is_known = ground.heights_m(at[:, 0], at[:, 1])
    over_m = at[:, 2] - up_m
    buried = np.flatnonzero(is_known & (over_m < -40.0))
    if len(buried):
        i = int(buried[np.argmin(over_m[buried])])
        warn(
            f"note: {found.where[list(places.values())[i]]}: the DEM has the camera {-over_m[i]:.0f} m under "
            "the ground: are its altitudes over the sea, in metres?"
        )
    heights = np.array([place[2] for place in places])
    ground_height_m = heights - over_m
    as_feet = heights * 0.3048 - ground_height_m
    if is_known.any() and (over_m[is_known] > 300.0).all() and (np.abs(as_feet[is_known]) < 60.0).all():
        warn("note: all altitudes agree with the DEM if they are feet: feet go into alt_msl_ft")
