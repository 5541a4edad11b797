"""Which of the targets that a soak's service confirmed are fires of the scenario; bounded for ever so many targets."""

import math
from collections import OrderedDict
from typing import Any

import msgspec
import numpy as np

from distloc.filter.uncertainty import ellipse_holds
from distloc.types import Ellipse
from service.simulator.scenario import Scenario, base_enu_m

_MOST = 1000
_LEAST_M = 55.0  # half a plume's width
_FAR = 2.0  # times its ellipse: chance leaves six in a million beyond that, and one in twenty beyond once
_MOST_ELLIPSE_M = 500.0  # a larger one does not make everything true


class TargetFound(msgspec.Struct, frozen=True, kw_only=True):
    """A target by its last report while it was confirmed, in metres; `is_inside` where its ellipse holds a fire."""

    target: int
    off_m: float
    semi_major_m: float
    semi_minor_m: float
    is_inside: bool
    is_false: bool


class TargetCount:
    """Takes reports; `found` are the newest 1000 targets."""

    def __init__(self, scenario: Scenario) -> None:
        self._frame = scenario.frame
        self._fires = [base_enu_m(target) for target in scenario.targets]
        self._found: OrderedDict[int, TargetFound] = OrderedDict()

    def take(self, report: dict[str, Any], place: tuple[float, float]) -> None:
        """A report's properties and its longitude and latitude."""
        if report["state"] != "confirmed":
            return
        at_enu_m = self._frame.enu_from_geodetic(place[1], place[0], report["altitude_msl_m"])
        offsets_m = [(fire - at_enu_m)[:2] for fire in self._fires]
        told = report["ellipse95"]
        major_m, minor_m = (float(told[f"semi_{name}_m"] or 0.0) for name in ("major", "minor"))
        azimuth_rad = math.radians(told["azimuth_deg"] or 0.0)
        far_m = [max(_FAR * min(axis_m, _MOST_ELLIPSE_M), _LEAST_M) for axis_m in (major_m, minor_m)]
        far = Ellipse(far_m[0], far_m[1], azimuth_rad)
        itself = Ellipse(max(major_m, 1e-3), max(minor_m, 1e-3), azimuth_rad)
        self._found[report["target"]] = TargetFound(
            target=report["target"],
            off_m=round(min(float(np.hypot(*offset_m)) for offset_m in offsets_m), 1),
            semi_major_m=major_m,
            semi_minor_m=minor_m,
            is_inside=any(ellipse_holds(itself, offset_m) for offset_m in offsets_m),
            is_false=not any(ellipse_holds(far, offset_m) for offset_m in offsets_m),
        )
        self._found.move_to_end(report["target"])
        if len(self._found) > _MOST:
            self._found.popitem(last=False)

    @property
    def found(self) -> list[TargetFound]:
        """Those that were confirmed at any time, the one told of last at the end."""
        return list(self._found.values())
