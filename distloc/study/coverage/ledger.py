"""What one filter reported on one flight, target by target, against the truth: the coverage study's accounts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.metrics import assignment, gospa, horizontal_error_m, nees
from distloc.types import BoolArray, FloatArray, TargetEstimate, TargetState

GOSPA_CUTOFF_M = 150.0  # half of what lies between two fires
LIVING = (TargetState.TENTATIVE, TargetState.CONFIRMED, TargetState.COASTING)
BELIEVED = (TargetState.CONFIRMED, TargetState.COASTING)


@dataclass(frozen=True, slots=True)
class Track:
    """One filter on one flight: (K, T) for K targets and T steps, NaN where none was reported for a target.

    Errors and normalised errors squared (2 degrees of freedom) are on the map; `is_inside` is 1 where the 95 % ellipse
    holds the truth; `is_believed` where the report was confirmed or coasting, and the ellipses' half-lengths. The rest
    is of the whole flight or of its end: how many targets are believed (confirmed or coasting), how many tracks were
    believed without ever being a target's, how often a target's track took over from another after it was believed, and
    the GOSPA of those believed.
    """

    error_m: FloatArray
    nees: FloatArray
    is_inside: FloatArray
    believed: int
    false_believed: int
    switches: int
    gospa_m: float
    half_length_m: FloatArray
    is_believed: BoolArray


class Ledger:
    """Keeps what one filter reported on one flight."""

    def __init__(self, truths_enu_m: FloatArray, steps: int) -> None:
        count = truths_enu_m.shape[1]
        self._truths_enu_m = truths_enu_m
        arrays = (np.full((count, steps), np.nan) for _ in range(4))
        self._error_m, self._nees, self._is_inside, self._half_length_m = arrays
        self._is_believed = np.zeros((count, steps), dtype=np.bool_)
        self._step = 0
        self._held: list[int | None] = [None] * count  # each target's believed track
        self._believed_ids: set[int] = set()
        self._targets_ids: set[int] = set()
        self._switches = 0
        self._last: list[TargetEstimate] = []

    def enter(self, estimates: Sequence[TargetEstimate]) -> None:
        """The next step's report."""
        for target, one in enumerate(of_targets(in_state(estimates, LIVING), self._truths_enu_m)):
            if one is not None:
                self._measure(target, one)
        self._last = in_state(estimates, BELIEVED)
        self._believed_ids |= {one.id for one in self._last}
        for target, one in enumerate(of_targets(self._last, self._truths_enu_m)):
            if one is not None:
                self._switches += self._held[target] not in (None, one.id)
                self._held[target] = one.id
                self._targets_ids.add(one.id)
        self._step += 1

    def closed(self) -> Track:
        """The whole flight."""
        places = np.array([one.position_enu_m[:2] for one in self._last]).reshape(-1, 2).T
        found = gospa(self._truths_enu_m[:2], places, GOSPA_CUTOFF_M)
        return Track(
            error_m=self._error_m,
            nees=self._nees,
            is_inside=self._is_inside,
            believed=sum(one is not None for one in of_targets(self._last, self._truths_enu_m)),
            false_believed=len(self._believed_ids - self._targets_ids),
            switches=self._switches,
            gospa_m=found.distance,
            half_length_m=self._half_length_m,
            is_believed=self._is_believed,
        )

    def _measure(self, target: int, one: TargetEstimate) -> None:
        truth = self._truths_enu_m[:, target]
        offset = (truth - one.position_enu_m)[:2]
        self._error_m[target, self._step] = horizontal_error_m(one.position_enu_m, truth)
        self._nees[target, self._step] = nees(offset, one.covariance_enu_m2[:2, :2])
        self._is_inside[target, self._step] = ellipse_holds(one.ellipse95, offset)
        self._half_length_m[target, self._step] = one.ellipse95.semi_major_m
        self._is_believed[target, self._step] = one.state in BELIEVED


def in_state(estimates: Sequence[TargetEstimate], states: Sequence[TargetState]) -> list[TargetEstimate]:
    return [one for one in estimates if one.state in states]


def of_targets(estimates: Sequence[TargetEstimate], truths_enu_m: FloatArray) -> list[TargetEstimate | None]:
    """Which estimate is each target's (3, K): of one target the one seen most, of several those that fit together.

    The sum of the squared distances on the map is least, and no estimate is two targets'.
    """
    held: list[TargetEstimate | None] = [None] * truths_enu_m.shape[1]
    if not estimates:
        return held
    if len(held) == 1:
        return [max(estimates, key=lambda one: (one.observations, -one.id))]
    positions = np.stack([one.position_enu_m for one in estimates], axis=1)
    squared = np.square(truths_enu_m[:2, :, None] - positions[:2, None, :]).sum(axis=0)
    for target, index in assignment(squared):
        held[target] = estimates[index]
    return held
