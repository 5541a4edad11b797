"""What one localizer reported of the one fire of a drawn flight, against the truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.metrics import horizontal_error_m
from distloc.study.coverage.ledger import BELIEVED, LIVING, in_state
from distloc.types import FloatArray, TargetEstimate


@dataclass(frozen=True, slots=True)
class FireTrack:
    """Frame by frame (T,): how many reports were believed (confirmed or coasting), and how many held the truth.

    Each believed report counts, a second one of the same fire too. `error_m` and `half_length_m` (T,) are of the one
    that was seen most, NaN where none was believed. `lost`: how often a target that had been believed ended though the
    fire was in view and no other was believed; `withdrawn`: how often the last belief was taken back in view, the
    target still followed.
    """

    believed: FloatArray
    held: FloatArray
    error_m: FloatArray
    half_length_m: FloatArray
    lost: int
    withdrawn: int


class FireLedger:
    """Takes one flight's reports in the order of time; the truth is (3,)."""

    def __init__(self, truth_enu_m: FloatArray) -> None:
        self._truth_enu_m = truth_enu_m
        self._rows: list[tuple[float, float, float, float]] = []
        self._ever: set[int] = set()  # living targets that were believed once
        self._was_believed = False
        self._lost = self._withdrawn = 0

    def enter(self, estimates: Sequence[TargetEstimate], is_in_view: bool) -> None:
        """The next frame's report; whether any of the fire's smoke is in the picture."""
        living = in_state(estimates, LIVING)
        believed = in_state(living, BELIEVED)
        ended = self._ever - {one.id for one in living}
        self._ever = (self._ever - ended) | {one.id for one in believed}
        if is_in_view and not believed:
            self._lost += bool(ended)
            self._withdrawn += self._was_believed and not ended
        self._was_believed = bool(believed)
        held = sum(ellipse_holds(one.ellipse95, self._offset_m(one)) for one in believed)
        self._rows.append((len(believed), held, *self._best(believed)))

    def closed(self) -> FireTrack:
        """The whole flight."""
        believed, held, error_m, half_length_m = np.array(self._rows, dtype=np.float64).reshape(-1, 4).T
        return FireTrack(believed, held, error_m, half_length_m, self._lost, self._withdrawn)

    def _best(self, believed: Sequence[TargetEstimate]) -> tuple[float, float]:
        if not believed:
            return np.nan, np.nan
        best = max(believed, key=lambda one: (one.observations, -one.id))
        return horizontal_error_m(best.position_enu_m, self._truth_enu_m), best.ellipse95.semi_major_m

    def _offset_m(self, one: TargetEstimate) -> FloatArray:
        return np.asarray((self._truth_enu_m - one.position_enu_m)[:2])
