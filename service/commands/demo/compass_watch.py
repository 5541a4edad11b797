"""What the scenery found out about the compass, against the truth; the demo knows that, as it has the scenario."""

import math
from dataclasses import dataclass

import cv2

from distloc.types import FloatArray
from service.localise.scenery import SceneryState
from service.localise.stage import Localised
from service.simulator.scenario import Scenario, camera_pose


@dataclass(slots=True)
class CompassWatch:
    """Keeps the last keyframe's heading error as measured, its sigma, and the true one; degrees, None before."""

    scenario: Scenario
    start_ns: int
    error_deg: float | None = None
    sigma_deg: float | None = None
    truth_deg: float | None = None
    why_not: str = ""

    def see(self, localised: Localised, state: SceneryState) -> None:
        """A frame and what the scenery says after it."""
        self.why_not = ", ".join(f"{reason} {count}" for reason, count in sorted(state.reasons.items()))
        error_rad, sigma_rad = state.heading_error_rad, state.sigma_rad
        if error_rad is None or sigma_rad is None or state.stamp_s != localised.pose.stamp_s:
            return
        t_s = (localised.frame.stamp_ns - self.start_ns) * 1e-9
        true = camera_pose(self.scenario, t_s, localised.pose.stamp_s)
        self.error_deg, self.sigma_deg = math.degrees(error_rad), math.degrees(float(sigma_rad[2]))
        self.truth_deg = math.degrees(heading_error_rad(localised.pose.R_cam_from_enu, true.R_cam_from_enu))

    def line(self) -> str:
        """For people."""
        if self.error_deg is None or self.sigma_deg is None or self.truth_deg is None:
            return f"the scenery did not measure the compass: {self.why_not or 'no step of the filter'}"
        return (
            f"compass off by {self.error_deg:+.2f} +- {self.sigma_deg:.2f} deg by the scenery, "
            f"in truth by {self.truth_deg:+.2f}"
        )


def heading_error_rad(R_reported: FloatArray, R_true: FloatArray) -> float:
    """By how much a reported camera-from-ENU (3, 3) is turned clockwise from above against the true one (3, 3)."""
    return -float(cv2.Rodrigues(R_reported.T @ R_true)[0][2, 0])
