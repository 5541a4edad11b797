"""What `locate` answers with."""

import math
from dataclasses import dataclass

from distloc.backports import StrEnum
from distloc.geometry.geodesy import LocalFrame
from distloc.types import Ellipse, FloatArray

LEAST_MORE = 2  # platforms that agree must be so many more than those that don't


class Unused(StrEnum):
    """Why a sighting is not part of any place."""

    DUPLICATE = "duplicate"
    MISFIT = "misfit"
    SAME_PICTURE = "same_picture"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, slots=True)
class Rejected:
    """A sighting that was not used, by its place in what was given. `beside_deg` is how far off it looks.

    `other` is the sighting that it repeats, or that was taken instead.
    """

    index: int
    reason: Unused
    beside_deg: float | None = None
    other: int | None = None


@dataclass(frozen=True, slots=True)
class Further:
    """A sighting that would help most: from where, as seen from the place, clockwise from north, and its gain."""

    from_azimuth_rad: float
    distance_m: float
    ellipse95: Ellipse


@dataclass(frozen=True, slots=True)
class Bearing:
    """What one camera says: the direction to the place with the half-width of its central 95 %, clockwise from north.

    `index` is the sighting whose camera it is. `platform` who carries it. `range95_m` is from where to where the slant
    ranges are that hold 95 %; where the range is not bounded, infinity is its end. `parts95_m` are the parts of it that
    do, more than one where ground hides what lies between.
    """

    index: int
    azimuth_rad: float
    azimuth95_rad: float
    range95_m: tuple[float, float]
    parts95_m: tuple[tuple[float, float], ...]
    platform: str = ""


@dataclass(frozen=True, slots=True)
class Place:
    """A target: where it is, or with too little parallax and no ground only in which direction.

    `position_enu_m` (3,), its covariance (3, 3) and `ellipse95` are None where the range is not bounded; then `bearing`
    is all that is known. `used` are the sightings, by their places in what was given. `heading_white_rad` is how far
    headings jump from sighting to sighting, as found, `scatter_rad` how far all of them do
    beyond what was told. `smoke_offset_m` is how far what was marked was taken to be from the target, and part of the
    regions. `against` are platforms of which most sightings do not bear the place out.
    """

    target: str
    used: tuple[int, ...]
    platforms: tuple[str, ...]
    bearing: Bearing
    position_enu_m: FloatArray | None
    covariance_enu_m2: FloatArray | None
    ellipse95: Ellipse | None
    vertical95_m: float | None
    lat_deg: float | None
    lon_deg: float | None
    height_m: float | None
    baseline_m: float
    parallax_rad: float
    heading_white_rad: float
    scatter_rad: float
    has_ground: bool
    further: Further | None
    smoke_offset_m: float = 0.0
    against: tuple[str, ...] = ()

    @property
    def is_disputed(self) -> bool:
        """Whether too few platforms agree: any two lines of sight nearly cross somewhere, so two against one is naught.

        Those that agree must be two more than those that don't.
        """
        agree = len(set(self.platforms) - set(self.against))
        return bool(self.against) and agree - len(self.against) < LEAST_MORE

    @property
    def is_bounded(self) -> bool:
        """Whether there is a position."""
        return self.position_enu_m is not None

    @property
    def is_rough(self) -> bool:
        """Whether the ellipse is over half the range, in the middle of its logarithm."""
        low_m, high_m = self.bearing.range95_m
        return self.ellipse95 is not None and self.ellipse95.semi_major_m >= 0.5 * math.sqrt(low_m * high_m)


@dataclass(frozen=True, slots=True)
class Located:
    """All places, what was not used, and what was taken otherwise than given; `frame` is that of the positions."""

    places: tuple[Place, ...]
    rejected: tuple[Rejected, ...]
    notes: tuple[str, ...]
    frame: LocalFrame
