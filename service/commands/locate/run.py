"""What `distloc locate` does: read, locate, print, write."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.batch.locate import MOST_SIGHTINGS, locate
from distloc.batch.place import Located
from distloc.filter.ground import FlatGround, Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from service.commands.locate import words
from service.commands.locate.writing import write_all
from service.commands.study.files import prepared
from service.config.load import load_config
from service.config.sections import DEM_SIGMA_M, FLAT_SIGMA_M
from service.localise.terrain.dem import ground_from_dem
from service.recordings.sightings.reading import SightingsError, read_table
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


def run_locate(paths: list[Path], wanted: Wanted, say: Callable[[str], None], warn: Callable[[str], None]) -> Located:
    """Print the places and write the files that are asked for; SightingsError where no row can be used."""
    config = load_config(wanted.config) if wanted.config else None
    if wanted.out:
        prepared(wanted.out)
    found = sightings_of([read_table(path) for path in paths], config, wanted.geoid_m, wanted.home)
    if len(found.sightings) > MOST_SIGHTINGS:
        raise SightingsError(
            f"{paths[0]}: {len(found.sightings)} sightings: at most {MOST_SIGHTINGS} are taken at once"
        )
    _tell_faults(found, warn)
    located = locate(
        found.sightings, ground=_ground(wanted, found, warn), range_m=(_LEAST_RANGE_M, 1e3 * wanted.max_range_km)
    )
    height_name = "over the ellipsoid" if found.is_ellipsoidal else "MSL"
    for line in [*words.table(located, height_name), *words.notes(located, found.where)]:
        say(line)
    if wanted.out:
        _write(wanted.out, located, found, say)
    if not located.places:
        raise SightingsError(f"{paths[0]}: no place: {words.why(located.rejected[0], found.where)}")
    return located


def _tell_faults(found: Sightings, warn: Callable[[str], None]) -> None:
    for line in found.faults[:_MOST_FAULTS]:
        warn(f"not used: {line}")
    if len(found.faults) > _MOST_FAULTS:
        warn(f"not used: {len(found.faults) - _MOST_FAULTS} more rows that can't be read")
    for line in found.notes:
        warn(f"note: {line}")


def _ground(wanted: Wanted, found: Sightings, warn: Callable[[str], None]) -> Callable[[LocalFrame], Ground] | None:
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


def _write(out: Path, located: Located, found: Sightings, say: Callable[[str], None]) -> None:
    names = write_all(out, located, found.sightings, found.where, found.is_ellipsoidal)
    try:
        from service.commands.locate.draw import draw_map

        draw_map(out / "map.png", located, found.sightings)
        names.append("map.png")
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        say("no map.png: matplotlib is not installed: pip install '.[study]'")
    say(f"wrote {out}/{', '.join(names)}")
