"""One fire located and compared with its known ignition, and all of them pooled."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.backports import StrEnum
from distloc.batch.locate import locate
from distloc.batch.place import Located
from distloc.batch.sighting import Sighting
from distloc.filter.ground import Ground
from distloc.filter.uncertainty import blurred, ellipse_holds
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.metrics import wilson_interval
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.study.ignitions.biases import Bias
from distloc.study.ignitions.known import KnownFire
from distloc.types import Ellipse, PoseErrors

_ROUGH = 0.5  # of the range is the ellipse of a place that nobody should be sent to


class Answer(StrEnum):
    """What is said of a fire."""

    LOCATED = "located"
    ROUGH = "rough"  # abstained: the region is over half the range
    DISAGREE = "disagree"  # abstained: nobody knows which platforms are right
    BEARING = "bearing"  # abstained: a direction is all that is known
    NOTHING = "nothing"  # abstained: no sighting could be used


@dataclass(frozen=True, slots=True)
class Scored:
    """A fire's answer; what can't be told is None.

    `error_m` is from the region's centre to the ignition, `holds` says whether the 95 % region has it, widened by what
    is told of the ignition's own error; `area_km2` is the region's, not widened. `smoke_m` is how far the smoke was
    taken to be from its fire, one standard deviation, and part of the region.
    """

    fire: str
    answer: Answer
    platforms: int
    sightings: int
    unused: int
    smoke_m: float
    lat_deg: float | None = None
    lon_deg: float | None = None
    ellipse95: Ellipse | None = None
    area_km2: float | None = None
    error_m: float | None = None
    holds: bool | None = None

    @property
    def is_located(self) -> bool:
        """Whether it counts: others are abstentions."""
        return self.answer is Answer.LOCATED


@dataclass(frozen=True, slots=True)
class Overall:
    """Of all fires with a known ignition: how many there are, were located, and of these held; medians of these."""

    fires: int
    located: int
    held: int
    error_m: float
    error90_m: float
    area_km2: float

    @property
    def coverage(self) -> float:
        """The share of the located fires whose region holds the ignition; NaN of none."""
        return self.held / self.located if self.located else math.nan

    @property
    def coverage95(self) -> tuple[float, float]:
        """Wilson's interval of it, for so many fires."""
        return wilson_interval(self.held, self.located)

    @property
    def abstained(self) -> float:
        """The share that was not located."""
        return 1.0 - self.located / self.fires if self.fires else math.nan


def scored(
    fire: KnownFire,
    errors: PoseErrors,
    least_smoke_m: float,
    ground: Callable[[LocalFrame], Ground] | None = None,
    range_m: tuple[float, float] = (10.0, 60_000.0),
    biases: Mapping[str, Bias] | None = None,
) -> Scored:
    """Locate a fire by its sightings alone, its platforms' headings corrected by `biases`, and compare."""
    sightings = [
        replace(_corrected(one, errors, biases), smoke_offset_m=max(one.smoke_offset_m, least_smoke_m))
        for one in fire.sightings
    ]
    located = locate(sightings, errors=errors, ground=ground, range_m=range_m)
    place = located.places[0] if located.places else None
    smoke_m = place.smoke_offset_m if place else least_smoke_m
    used = len(place.used) if place else 0
    said = Scored(
        fire.name, _answer(located), len(place.platforms) if place else 0, used, len(sightings) - used, smoke_m
    )
    if place is None or place.ellipse95 is None or place.lat_deg is None or place.lon_deg is None:
        return said
    ellipse = place.ellipse95
    area_km2 = math.pi * ellipse.semi_major_m * ellipse.semi_minor_m / 1e6
    said = replace(said, lat_deg=place.lat_deg, lon_deg=place.lon_deg, ellipse95=ellipse, area_km2=area_km2)
    if fire.ignition is None:
        return said
    frame = LocalFrame(place.lat_deg, place.lon_deg, place.height_m or 0.0)
    offset_m = frame.enu_from_geodetic(fire.ignition.lat_deg, fire.ignition.lon_deg, place.height_m or 0.0)[:2]
    wide = blurred(ellipse, fire.ignition.sigma_m**2 * np.eye(2))
    return replace(said, error_m=float(np.hypot(*offset_m)), holds=ellipse_holds(wide, offset_m))


def overall(fires: Sequence[Scored]) -> Overall:
    """Of fires whose ignition is known: `scored` gave them an error where they have a place."""
    located = [one for one in fires if one.is_located and one.error_m is not None]
    errors = np.array([one.error_m for one in located]) if located else np.array([math.nan])
    areas = np.array([one.area_km2 for one in located]) if located else np.array([math.nan])
    return Overall(
        len(fires),
        len(located),
        sum(bool(one.holds) for one in located),
        float(np.median(errors)),
        float(np.quantile(errors, 0.9)),
        float(np.median(areas)),
    )


def _corrected(one: Sighting, errors: PoseErrors, biases: Mapping[str, Bias] | None) -> Sighting:
    """A sighting turned back by what its platform errs by, which is then as sure as that is."""
    if biases is None or one.platform not in biases:
        return one
    bias = biases[one.platform]
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, bias.mean_rad])) @ one.direction_enu  # to the left
    told = replace(one.errors or errors, heading_bias_rad=bias.sigma_rad)
    return replace(one, direction_enu=turned / np.linalg.norm(turned), errors=told)


def _answer(located: Located) -> Answer:
    if not located.places:
        return Answer.NOTHING
    place = located.places[0]
    if len(located.places) > 1 or place.is_disputed:
        return Answer.DISAGREE
    if place.ellipse95 is None:
        return Answer.BEARING
    range_m = float(np.mean(place.bearing.range95_m))
    return Answer.ROUGH if place.ellipse95.semi_major_m > _ROUGH * range_m else Answer.LOCATED
