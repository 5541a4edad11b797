"""The mount's angles over the flight, by what the scenery says of the reported attitude at each keyframe.

`scenery` owns one and asks it after each keyframe; the status, the demo and the replay tell what it found.
"""

import math
from dataclasses import dataclass

import numpy as np

from distloc.calibration.mount_calibration import wrapped_rad
from distloc.calibration.scenery_mount import LEAST_KEYFRAMES, AttitudeSight, MountEstimator
from distloc.scenery.compass import CompassState
from distloc.types import PoseErrors
from service.config.sections import MountConfig

ANGLES = ("yaw", "pitch", "roll")
SURE = 4.0  # standard deviations
OFF_DEG = 0.5  # less is not worth a new config


@dataclass(frozen=True, slots=True)
class MountState:
    """By how much yaw, pitch and roll of the config are more than those of the mount, with one sigma of each.

    An angle is None where it is no surer than `[pose_errors]` tells. `turned_rad` is how far apart the craft's headings
    were, over one turn where it circled: on one heading a compass that is off looks like the mount's yaw.
    """

    error_rad: tuple[float | None, float | None, float | None]
    sigma_rad: tuple[float | None, float | None, float | None]
    turned_rad: float


class MountWatch:
    """Takes keyframes; `told` are the sizes of the attitude's slow errors, the mount's included."""

    def __init__(self, mount: MountConfig, told: PoseErrors) -> None:
        self.state: MountState | None = None
        self._mount = mount
        self._told_rad = (told.heading_bias_rad, told.tilt_bias_rad, told.tilt_bias_rad)
        self._begin()

    def _begin(self) -> None:
        self._estimator, self._stamp_s = MountEstimator(self._mount.R_body_from_mount), -math.inf

    def note(self, said: CompassState) -> None:
        """What the scenery says after a step; the same keyframe is taken once."""
        pose = said.reported
        if pose is None or pose.errors is None or said.stamp_s == self._stamp_s:
            return
        self._stamp_s = said.stamp_s
        try:
            self._estimator.add(AttitudeSight(pose, pose.errors, said.error_rad, said.covariance_rad2))
            self.state = self._found()
        except np.linalg.LinAlgError:  # of a covariance that is none
            self._begin()
            self.state = None

    def _found(self) -> MountState | None:
        if self._estimator.count < LEAST_KEYFRAMES:
            return None
        found, mount = self._estimator.mount(), self._mount
        given_rad = np.radians([mount.yaw_deg, mount.pitch_deg, mount.roll_deg])
        off_rad = wrapped_rad(given_rad - found.angles_rad).tolist()
        pairs = [
            (off, sigma) if sigma < told else (None, None)
            for off, sigma, told in zip(off_rad, found.sigmas_rad.tolist(), self._told_rad, strict=True)
        ]
        errors, sigmas = zip(*pairs, strict=True)
        return None if errors == (None, None, None) else MountState(errors, sigmas, found.turned_rad)


def mount_line(state: MountState | None, mount: MountConfig) -> str | None:
    """Which keys of the config are surely off and what would be right, in one line; None where none is."""
    if state is None:
        return None
    off = []
    for name, error_rad, sigma_rad in zip(ANGLES, state.error_rad, state.sigma_rad, strict=True):
        if error_rad is None or sigma_rad is None:
            continue
        given_deg, error_deg, sigma_deg = getattr(mount, f"{name}_deg"), *np.degrees([error_rad, sigma_rad])
        if abs(error_deg) > max(OFF_DEG, SURE * sigma_deg):
            new_deg = math.fmod(given_deg - error_deg, 360.0)
            off.append(f"camera.mount.{name}_deg is {given_deg:g}, set it to {new_deg:.1f} (+- {sigma_deg:.1f})")
    turned_deg = min(math.degrees(state.turned_rad), 360.0)
    return f"the mount is off, by the scenery over {turned_deg:.0f} deg of heading: {'; '.join(off)}" if off else None
