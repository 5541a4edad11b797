"""Towers that look at one place, each with an attitude that is wrong in its own way."""

from collections.abc import Sequence

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors, TargetEstimate

CAMERA = Camera(width=1920, height=1080, fx=1662.8, fy=1662.8, cx=960.0, cy=540.0, distortion=())
FIRE_ENU_M = np.array([0.0, 0.0, 200.0])
WHITE_RAD, PIXEL_PX = float(np.radians(0.1)), 3.0
FOR_GOOD_S = 1e7


def looking_at(camera_enu_m: FloatArray, place_enu_m: FloatArray) -> FloatArray:
    """The turn (3, 3), cam from enu, of a level camera."""
    forward = (place_enu_m - camera_enu_m) / np.linalg.norm(place_enu_m - camera_enu_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


class Towers:
    """At places (t, 3), with errors (t, 3) about east, north and up of up to these sigmas; the tilt's and heading's."""

    def __init__(self, places_enu_m: FloatArray, biases_rad: FloatArray, tilt_deg: float, heading_deg: float) -> None:
        self.places_enu_m, self.biases_rad = places_enu_m, biases_rad
        self.sigmas_rad = np.radians([tilt_deg, tilt_deg, heading_deg])
        heading_rad, tilt_rad = float(self.sigmas_rad[2]), float(self.sigmas_rad[0])
        self.errors = PoseErrors(heading_rad, tilt_rad, WHITE_RAD, 1.0, FOR_GOOD_S)

    @classmethod
    def drawn(cls, rng: np.random.Generator, count: int, tilt_deg: float = 0.5, heading_deg: float = 3.0) -> "Towers":
        """Anywhere around the fire, 10 to 27 km away."""
        azimuth_rad, range_m = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(10e3, 27e3, count)
        heights_m = rng.uniform(200.0, 900.0, count)
        places = np.stack([range_m * np.sin(azimuth_rad), range_m * np.cos(azimuth_rad), heights_m], axis=1)
        sigmas_rad = np.radians([tilt_deg, tilt_deg, heading_deg])
        return cls(places, rng.standard_normal((count, 3)) * sigmas_rad, tilt_deg, heading_deg)

    def seen(
        self, tower: int, stamp_s: float, rng: np.random.Generator, name: str | None = None
    ) -> tuple[CameraPose, list[Detection]]:
        """What one of them reports of the fire, its camera turned a little beside it; `name` if not its own."""
        place, bias = self.places_enu_m[tower], self.biases_rad[tower]
        R_cam_from_enu = looking_at(place, FIRE_ENU_M + np.array([600.0, -400.0, 0.0]))
        pixel, _ = CAMERA.project((R_cam_from_enu @ (FIRE_ENU_M - place))[:, None])
        u_px, v_px = (pixel[:, 0] + rng.normal(0.0, PIXEL_PX, 2)).tolist()
        off = matrix_from_rotation_vector(bias + WHITE_RAD * rng.standard_normal(3))
        reported = (off @ R_cam_from_enu.T).T
        platform = f"tower{tower}" if name is None else name
        pose = CameraPose(stamp_s, place, reported, errors=self.errors, platform=platform)
        return pose, [Detection.from_point(u_px, v_px, PIXEL_PX)]

    def localizer(self, seed: int, **changes: object) -> Localizer:
        """One that tells them apart and sees as far as they do."""
        settings: dict[str, object] = {
            "platforms": len(self.places_enu_m),
            "range_m": (50.0, 80e3),
            "n_particles": 16_384,
        }
        config = LocalizerConfig(**{**settings, **changes})  # type: ignore[arg-type]
        return Localizer(CAMERA, config, rng=np.random.default_rng(seed))

    def watched(
        self, located: Localizer, rng: np.random.Generator, looks: int, name: str | None = None
    ) -> list[TargetEstimate]:
        """What is told after each of them has looked so often, in turn."""
        estimates: list[TargetEstimate] = []
        for look in range(looks):
            for tower in range(len(self.places_enu_m)):
                stamp_s = 60.0 * look + 2.0 * tower
                estimates = located.step_detections(*self.seen(tower, stamp_s, rng, name))
        return estimates

    def bound_m2(self, looks: int) -> FloatArray:
        """Covariance (2, 2) on the map of the least squares of all sightings at once, one bias a tower, with its prior.

        No unbiased method does better, where it is linear.
        """
        unknowns = 3 + 3 * len(self.places_enu_m)
        information = np.zeros((unknowns, unknowns))
        for tower, place in enumerate(self.places_enu_m):
            own = slice(3 + 3 * tower, 6 + 3 * tower)
            information[own, own] += np.diag(1.0 / self.sigmas_rad**2)
            right, down, _ = looking_at(place, FIRE_ENU_M)
            range_m = float(np.linalg.norm(FIRE_ENU_M - place))
            H = np.zeros((2, unknowns))
            H[:, :3], H[0, own], H[1, own] = np.stack([right, down]) / range_m, down, -right
            white = WHITE_RAD**2 + (PIXEL_PX / CAMERA.fx) ** 2 + (1.0 / range_m) ** 2
            information += looks * H.T @ H / white
        return np.asarray(np.linalg.inv(information)[:2, :2])


def area_m2(covariance_m2: FloatArray) -> float:
    """Of the 95 % ellipse."""
    return float(5.991 * np.pi * np.sqrt(np.linalg.det(covariance_m2)))


def placed(*places: Sequence[float]) -> FloatArray:
    """Places (t, 3)."""
    return np.array(places, dtype=np.float64)
