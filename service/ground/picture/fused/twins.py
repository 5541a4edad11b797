"""Which fires of different drones may be one: those whose 95 % ellipses overlap. Free of I/O."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.ground.picture.fire import Fire

MOST_EACH = 8
MOST_PAIRS = 20_000  # whose circles meet; with more, crowds in one place, the rest is not compared
_LIVE = frozenset({"confirmed", "coasting", "tentative"})
_LARGEST_M = 20_000.0  # an ellipse beyond that meets all others, which tells nothing
_ROWS = 256  # at a time
_METRES_A_DEGREE = 111_320.0
_SHARES = 1.0 / (1.0 + np.exp(np.linspace(-5.0, 5.0, 25)))

IntArray = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Shapes:
    """The ellipses of fires: `values` (N, 5) are latitude, longitude, semi-axes and azimuth in degrees."""

    ids: list[str]
    values: FloatArray
    vehicle: IntArray

    @classmethod
    def of(cls, fires: Mapping[str, Fire]) -> "Shapes":
        """Of those that are places of fires."""
        shapes = {one: shape for one, fire in fires.items() if (shape := _shape(fire)) is not None}
        ids = list(shapes)
        vehicle = np.unique([fires[one].vehicle for one in ids], return_inverse=True)[1]
        return cls(ids, np.array(list(shapes.values())).reshape(-1, 5), vehicle)

    def near(self, reach: float = 1.0) -> tuple[IntArray, IntArray]:
        """Rows of pairs of different drones whose circles, so many times as large as the ellipses, meet."""
        if not self.ids or not self.vehicle.any():
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        values = self.values.copy()
        values[:, 2] *= reach
        return _near(values, self.vehicle)

    def meet(self, first: IntArray, second: IntArray) -> NDArray[np.bool_]:
        """Whether the ellipses of rows `first` and `second` (N,) overlap."""
        one, other = self.values[first], self.values[second]
        return overlap(_matrices(one), _matrices(other), _away_m(one, other))


def twins(fires: Mapping[str, Fire]) -> dict[str, list[str]]:
    """By the id of each fire that may be another drone's, the ids of those, the nearest first, 8 at most."""
    shapes = Shapes.of(fires)
    ids, values = shapes.ids, shapes.values
    first, second = shapes.near()
    away_m = _away_m(values[first], values[second])
    is_one = overlap(_matrices(values[first]), _matrices(values[second]), away_m)
    found: dict[str, list[tuple[float, str]]] = {}
    for i, j, metres in zip(first[is_one], second[is_one], np.hypot(*away_m[:, is_one]), strict=True):
        found.setdefault(ids[i], []).append((float(metres), ids[j]))
        found.setdefault(ids[j], []).append((float(metres), ids[i]))
    return {one: [other for _, other in sorted(others)[:MOST_EACH]] for one, others in found.items()}


def overlap(first: FloatArray, second: FloatArray, away: FloatArray) -> NDArray[np.bool_]:
    """Whether two ellipses meet, by the contact function of Perram and Wertheim (1985): 1 at most.

    `first` and `second` are xx, xy, yy (3, N) of matrices that have the squared semi-axes; `away` leads from centre to
    centre (2, N).
    """
    x, y = away
    largest = np.zeros(away.shape[1])
    for share in _SHARES:
        xx, xy, yy = (1.0 - share) * first + share * second
        largest = np.maximum(
            largest, share * (1.0 - share) * (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy)
        )
    return np.asarray(largest <= 1.0)


def _shape(fire: Fire) -> tuple[float, float, float, float, float] | None:
    """Latitude, longitude, semi-axes and azimuth in degrees; None where it is no place of a fire."""
    said, geometry = fire.report.properties, fire.report.geometry
    one = said.ellipse95
    if said.state not in _LIVE or geometry is None or len(geometry.coordinates) < 2:
        return None
    if one.semi_major_m is None or one.semi_minor_m is None or one.azimuth_deg is None:
        return None
    if not (0.1 <= one.semi_minor_m <= one.semi_major_m <= _LARGEST_M and abs(one.azimuth_deg) <= 360.0):
        return None
    lon_deg, lat_deg = geometry.coordinates[:2]
    return lat_deg, lon_deg, one.semi_major_m, one.semi_minor_m, one.azimuth_deg


def _near(values: FloatArray, vehicle: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of pairs of different drones whose circles about the ellipses meet; each pair once."""
    firsts, seconds, found = [], [], 0
    for start in range(0, len(values), _ROWS):
        rows = slice(start, start + _ROWS)
        away_deg = np.abs(values[rows, 0][:, None] - values[:, 0])
        reach_m = values[rows, 2][:, None] + values[:, 2]
        is_near = (away_deg * 110_500.0 <= reach_m) & (vehicle[rows][:, None] != vehicle)
        first, second = np.nonzero(np.triu(is_near, start + 1))
        first += start
        is_met = np.hypot(*_away_m(values[first], values[second])) <= values[first, 2] + values[second, 2]
        firsts.append(first[is_met])
        seconds.append(second[is_met])
        found += len(firsts[-1])
        if found > MOST_PAIRS:
            break
    return np.concatenate(firsts)[:MOST_PAIRS], np.concatenate(seconds)[:MOST_PAIRS]


def _away_m(first: FloatArray, second: FloatArray) -> FloatArray:
    """East and north (2, N) from one place to the other, by a plane between them: within half a percent."""
    middle = np.radians(0.5 * (first[:, 0] + second[:, 0]))
    lon_deg = (second[:, 1] - first[:, 1] + 180.0) % 360.0 - 180.0
    return np.stack([lon_deg * np.cos(middle), second[:, 0] - first[:, 0]]) * _METRES_A_DEGREE


def _matrices(values: FloatArray) -> FloatArray:
    """xx, xy, yy of each (3, N); x is east."""
    _, _, major, minor, azimuth_deg = values.T
    east, north = np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))
    a, b = major**2, minor**2
    return np.stack([a * east**2 + b * north**2, (a - b) * east * north, a * north**2 + b * east**2])
