"""Ways that a craft can fly from where it is within a given time: legs all round, and arcs about the target."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.types import BoolArray, FloatArray

HEADINGS = 24  # legs, 15 degrees apart
_SHARES = (0.5, 1.0)  # of the way that there is time for
_ARC_SHARE = 0.2  # of the range: a shorter arc is a leg
STOPS = 16  # places along a way from which sights are foretold


@dataclass(frozen=True, slots=True)
class Craft:
    """How a craft flies and what its camera can see meanwhile.

    `keeps_target`: the camera stays on the target, by its gimbal or because the craft flies with its nose on it. Else
    the nose is along the way, and the target is seen where it is within `half_view_rad` of `camera_yaw_rad` to the
    right of that. With a gimbal the nose is along the way as well.
    """

    speed_mps: float = 10.0
    flight_s: float = 60.0
    keeps_target: bool = True
    has_gimbal: bool = False
    half_view_rad: float = 0.5
    camera_yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        """ValueError for what no craft can do."""
        if not (0.0 < self.speed_mps < np.inf and 0.0 < self.flight_s < np.inf and self.half_view_rad > 0.0):
            raise ValueError(f"speed_mps, flight_s and half_view_rad must be > 0 and finite, got {self}")

    @property
    def is_nose_along(self) -> bool:
        """Whether the craft's heading is its course."""
        return self.has_gimbal or not self.keeps_target

    def sees(self, off_rad: FloatArray) -> BoolArray:
        """Whether what is so far to the right of the course, any shape, is in view of a camera that is fixed."""
        off_rad = off_rad - self.camera_yaw_rad
        return np.asarray(np.abs((off_rad + np.pi) % (2.0 * np.pi) - np.pi) < self.half_view_rad)


@dataclass(frozen=True, slots=True)
class Ways:
    """n ways: places (n, STOPS, 2) and courses (n, STOPS) east and north of the start, one stop after the other.

    `heading_rad` (n,) is the course they begin with, `length_m` (n,) how long they are; `kind` says what each is.
    """

    kinds: tuple[Literal["leg", "arc"], ...]
    heading_rad: FloatArray
    length_m: FloatArray
    places_m: FloatArray
    courses_rad: FloatArray

    def __len__(self) -> int:
        return len(self.kinds)


def ways_of(craft: Craft, target_en_m: FloatArray) -> Ways:
    """Those that the craft has time for; the target is at about (2,) east and north of it."""
    longest_m = craft.speed_mps * craft.flight_s
    headings = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    heading_rad, length_m = (one.reshape(-1) for one in np.meshgrid(headings, np.array(_SHARES) * longest_m))
    return ways_along(heading_rad, length_m, np.zeros(len(heading_rad)), target_en_m)


def arcs_of(craft: Craft, target_en_m: FloatArray) -> Ways:
    """Arcs about the target, to either side; none where they would be as good as straight."""
    range_m, longest_m = float(np.hypot(*target_en_m)), craft.speed_mps * craft.flight_s
    bearing_rad = float(np.arctan2(*target_en_m))
    lengths = [share * longest_m for share in _SHARES if share * longest_m > _ARC_SHARE * range_m]
    turned = np.array([side * length_m / max(range_m, 1.0) for length_m in lengths for side in (-1.0, 1.0)])
    heading_rad = (bearing_rad - np.sign(turned) * np.pi / 2.0) % (2.0 * np.pi)
    return ways_along(heading_rad, np.repeat(lengths, 2), turned, target_en_m)


def ways_along(heading_rad: FloatArray, length_m: FloatArray, turned_rad: FloatArray, target_en_m: FloatArray) -> Ways:
    """Of courses (n,) to begin with and lengths (n,); those that turn about the target (2,) do so by angles (n,)."""
    share = np.arange(1, STOPS + 1) / STOPS
    flown_m = length_m[:, None] * share
    along = np.stack([np.sin(heading_rad), np.cos(heading_rad)], axis=1)
    places = flown_m[:, :, None] * along[:, None]
    courses = np.broadcast_to(heading_rad[:, None], flown_m.shape).copy()
    is_arc = turned_rad != 0.0
    angle = turned_rad[is_arc, None] * share  # clockwise as seen from above
    sine, cosine = np.sin(angle), np.cos(angle)
    east, north = -target_en_m  # from the target to the craft
    places[is_arc] = target_en_m + np.stack([cosine * east + sine * north, cosine * north - sine * east], axis=2)
    courses[is_arc] += angle
    kinds: tuple[Literal["leg", "arc"], ...] = tuple("arc" if one else "leg" for one in is_arc)
    return Ways(kinds, heading_rad, np.asarray(length_m, np.float64), places, courses % (2.0 * np.pi))
