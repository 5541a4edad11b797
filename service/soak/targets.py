"""Which of the targets that a soak's service confirmed are fires of the scenario; bounded for ever so many targets."""

from collections import OrderedDict
from typing import Any

import numpy as np

from service.scenario import Scenario, centre_enu_m

_MOST = 1000
_MOST_ELLIPSE_M = 300.0  # a larger one does not make everything true
_LEAST_M = 150.0  # a plume's own width and what a wrong compass may add beside the ellipse


class TargetCount:
    """Takes reports; a target counts by its last report while it was confirmed."""

    def __init__(self, scenario: Scenario) -> None:
        self._frame = scenario.frame
        self._centres = [centre_enu_m(target) for target in scenario.targets]
        self._is_true: OrderedDict[int, bool] = OrderedDict()

    def take(self, report: dict[str, Any], place: tuple[float, float]) -> None:
        """A report's properties and its longitude and latitude."""
        if report["state"] != "confirmed":
            return
        at_enu_m = self._frame.enu_from_geodetic(place[1], place[0], report["altitude_msl_m"])
        off_m = min(float(np.hypot(*(at_enu_m - centre)[:2])) for centre in self._centres)
        ellipse_m = min(report["ellipse95"]["semi_major_m"] or 0.0, _MOST_ELLIPSE_M)
        self._is_true[report["target"]] = off_m < _LEAST_M + ellipse_m
        self._is_true.move_to_end(report["target"])
        if len(self._is_true) > _MOST:
            self._is_true.popitem(last=False)

    @property
    def true(self) -> int:
        """Near a fire."""
        return sum(self._is_true.values())

    @property
    def false(self) -> int:
        """Elsewhere."""
        return len(self._is_true) - self.true
