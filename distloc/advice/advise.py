"""The advice for one target: the way after which its ellipse is likely to be the smallest."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.advice.foretell import half_lengths_m
from distloc.advice.ways import Craft, Ways, arcs_of, ways_of
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import FloatArray

_WORTH_IT = 0.8  # of the half-length as it is: what gains less is not worth flying
_AS_GOOD = 1.05  # of the best's: the shortest of these is taken
_LEAST_SHARE = 0.4  # of its nearest likely range: no nearer to the target
_LEAST_M = 150.0


@dataclass(frozen=True, slots=True)
class Advice:
    """Fly so, and the 95 % ellipse is likely to have this half-length afterwards.

    `heading_rad` is the course to begin with, clockwise from north; an arc goes on about the target, which stays as far
    as it is. `half_length_m` is the median over where the target may be, `low_m` to `high_m` holds 80 %.
    """

    target: int
    kind: Literal["leg", "arc"]
    heading_rad: float
    length_m: float
    seconds: float
    half_length_m: float
    low_m: float
    high_m: float


def advise(outlook: Outlook, craft: Craft, half_length_now_m: float) -> Advice | None:
    """None where no way makes the ellipse, whose half-length is given, shorter by a fifth."""
    target_en_m = float(np.median(outlook.ranges_m)) * outlook.axes[2, :2]
    found = [_best(outlook, ways, craft) for ways in (ways_of(craft, target_en_m), arcs_of(craft, target_en_m))]
    usable = [one for one in found if one is not None]
    if not usable:
        return None
    best = min(usable, key=lambda one: one.half_length_m)
    return best if best.half_length_m < _WORTH_IT * half_length_now_m else None


def _best(outlook: Outlook, ways: Ways, craft: Craft) -> Advice | None:
    may = np.flatnonzero(_stay_away(outlook, ways)) if len(ways) else np.array([], np.intp)
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
    seconds = length_m / craft.speed_mps + (0.0 if craft.keeps_target else craft.look_s)
    return Advice(
        outlook.id,
        ways.kinds[chosen],
        float(ways.heading_rad[chosen]) % (2.0 * math.pi),
        length_m,
        seconds,
        middle_m,
        low_m,
        high_m,
    )


def _stay_away(outlook: Outlook, ways: Ways) -> FloatArray:
    """Whether each (n,) stays away from the target, were it as near as it may be."""
    nearest_m = float(outlook.ranges_m[0])
    least_m = min(max(_LEAST_SHARE * nearest_m, _LEAST_M), 0.9 * nearest_m)
    offset_m = nearest_m * outlook.axes[2, :2] - ways.places_m
    return np.asarray(np.hypot(offset_m[:, :, 0], offset_m[:, :, 1]).min(axis=1) >= least_m)
