"""The advice for one target: the way after which its ellipse is likely to be the smallest."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.advice.foretell import half_lengths_m
from distloc.advice.ways import Craft, Ways, arcs_of, ways_of
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import BoolArray

_WORTH_IT = 0.8  # of the half-length as it is: what gains less is not worth flying
_AS_GOOD = 1.05  # of the best's: the shortest of these is taken
_FORETOLD = 2.2  # from the least to the most of what is foretold: more is no promise
_LEAST_SHARE = 0.4  # of its nearest likely range: no nearer to the target
_LEAST_M = 150.0


@dataclass(frozen=True, slots=True)
class Advice:
    """Fly so, and the 95 % ellipse is likely to have this half-length afterwards.

    `heading_rad` is the course to begin with, clockwise from north; an arc goes on about the target, which stays as far
    as it is, to the right or to the left. `half_length_m` is the median over where the target may be; None where that
    is so unsure that nobody can tell, and for a camera that cannot be kept on the target: then it was 1.4 times as
    long as foretold, and often longer. `likely_m` is the geometric mean, by which ways are compared.
    """

    target: int
    kind: Literal["leg", "arc"]
    turns_right: bool
    heading_rad: float
    length_m: float
    seconds: float
    half_length_m: float | None
    likely_m: float


def advise(outlook: Outlook, craft: Craft, half_length_now_m: float) -> Advice | None:
    """None where no way makes the ellipse, whose half-length is given, shorter by a fifth."""
    target_en_m = float(np.median(outlook.ranges_m)) * outlook.axes[2, :2]
    found = [_best(outlook, ways, craft) for ways in (ways_of(craft, target_en_m), arcs_of(craft, target_en_m))]
    usable = [one for one in found if one is not None]
    if not usable:
        return None
    best = min(usable, key=lambda one: one.likely_m)
    return best if best.likely_m < _WORTH_IT * half_length_now_m else None


def _best(outlook: Outlook, ways: Ways, craft: Craft) -> Advice | None:
    may = np.flatnonzero(_stay_away(outlook, ways) & _keep_in_view(outlook, ways, craft))
    if not may.size:
        return None
    halves_m = half_lengths_m(outlook, ways, craft)
    likely_m = np.exp(np.log(halves_m).mean(axis=1))
    least_m = float(likely_m[may].min())
    alike = may[likely_m[may] <= _AS_GOOD * least_m]
    shortest = alike[ways.length_m[alike] <= ways.length_m[alike].min() + 1e-6]
    chosen = int(shortest[np.argmin(likely_m[shortest])])
    low_m, middle_m, high_m = np.quantile(halves_m[chosen], (0.0, 0.5, 1.0)).tolist()
    length_m = float(ways.length_m[chosen])
    is_foretold = craft.keeps_target and high_m <= _FORETOLD * low_m
    return Advice(
        outlook.id,
        ways.kinds[chosen],
        bool(np.sin(ways.courses_rad[chosen, -1] - ways.heading_rad[chosen]) > 0.0),
        float(ways.heading_rad[chosen]) % (2.0 * math.pi),
        length_m,
        length_m / craft.speed_mps,
        middle_m if is_foretold else None,
        float(likely_m[chosen]),
    )


def _keep_in_view(outlook: Outlook, ways: Ways, craft: Craft) -> BoolArray:
    """Whether the target stays in view on each (n,), as near and as far as half of the probability has it."""
    if craft.keeps_target:
        return np.ones(len(ways), np.bool_)
    points_m = outlook.ranges_m[1:-1, None] * outlook.axes[2, :2]
    offset_m = points_m - ways.places_m[:, :, None]
    bearings = np.arctan2(offset_m[..., 0], offset_m[..., 1])
    return np.asarray(craft.sees(bearings - ways.courses_rad[:, :, None]).all(axis=(1, 2)))


def _stay_away(outlook: Outlook, ways: Ways) -> BoolArray:
    """Whether each (n,) stays away from the target, were it as near as it may be."""
    nearest_m = float(outlook.ranges_m[0])
    least_m = min(max(_LEAST_SHARE * nearest_m, _LEAST_M), 0.9 * nearest_m)
    offset_m = nearest_m * outlook.axes[2, :2] - ways.places_m
    return np.asarray(np.hypot(offset_m[:, :, 0], offset_m[:, :, 1]).min(axis=1) >= least_m)
