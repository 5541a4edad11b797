"""A camera that looks beside a fire, so that the picture's border goes through its root; the staging asks."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distloc.filter.turning import camera_azimuth_rad
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.simulation.paths import Wobble
from distloc.study.fires.smoke import Source
from distloc.types import CameraPose

_SWAY_RAD = 0.005


@dataclass(frozen=True, slots=True)
class Border:
    """Until `until_s` a fire is at the right or left border (`side` 1 or -1), out of it by `outside_m`.

    Where that is negative the fire is in the picture, and only smoke of its is cut. The gimbal sways.
    """

    source: Source
    side: float
    outside_m: float
    until_s: float
    sway: Wobble

    @classmethod
    def drawn(cls, source: Source, until_s: float, seed: int, rng: np.random.Generator) -> "Border":
        """A side by chance, and how far out: at most three quarters of a root's radius either way."""
        side, outside_m = float(rng.choice([-1.0, 1.0])), source.look.root_m * float(rng.uniform(-0.75, 0.75))
        return cls(source, side, outside_m, until_s, Wobble(_SWAY_RAD, seed))

    def aside(self, pose_at: Callable[[float], CameraPose], camera: Camera) -> Callable[[float], CameraPose]:
        """The same craft with its camera turned about up."""
        edge_rad = np.arctan((camera.width - 1.0 - camera.cx) / camera.fx)

        def turned(stamp_s: float) -> CameraPose:
            pose = pose_at(stamp_s)
            if stamp_s >= self.until_s:
                return pose
            off_m = self.source.at(stamp_s) - pose.position_enu_m
            beyond_rad = edge_rad + np.arctan(self.outside_m / max(float(np.hypot(*off_m[:2])), 1.0))
            wanted_rad = np.arctan2(off_m[0], off_m[1]) - self.side * beyond_rad + float(self.sway.at(stamp_s)[0])
            turn_rad = wanted_rad - camera_azimuth_rad(pose.R_cam_from_enu)
            # azimuths are clockwise, so the world turns the other way under the camera
            turn = matrix_from_rotation_vector(np.array([0.0, 0.0, turn_rad]))
            return replace(pose, R_cam_from_enu=pose.R_cam_from_enu @ turn)

        return turned
