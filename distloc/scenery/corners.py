"""Corners of the scenery in a frame: what the tracker gives, and what the window takes."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.scenery.landmarks import Seen
from distloc.types import CameraPose, FloatArray

_STEP_PX = 0.5
_LEAST_HEIGHT_M = 20.0  # above the ground, for the first guess of how far a corner is
_LEAST_DOWN = 0.02
_LEAST_AREA = 1e-10  # steradians of a pixel
_MOST_OFF_PX = 0.5  # there and back through the lens' model


@dataclass(frozen=True, slots=True)
class KnownCorners:
    """Landmarks of one frame: which they are (n,), pixels (2, n) as in `Corners`, places (n, 3) in ENU, sigmas (n,)."""

    names: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    pixels: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    sigma_px: FloatArray = field(default_factory=lambda: np.zeros(0))
    places_enu_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners of one frame: a name (n,) that stays while one is followed, pixels (2, n) of the full-size image.

    `sigma_px` (n,) is one standard deviation of each pixel coordinate. `known` are landmarks whose places are known.
    `usual` is what the squared errors from frame to frame commonly are of sigma's square: who tells more than those for
    what stays longer has less.
    """

    names: NDArray[np.int64]
    pixels: FloatArray
    sigma_px: FloatArray
    known: KnownCorners = field(default_factory=KnownCorners)
    usual: float = 1.0

    @classmethod
    def none(cls) -> "Corners":
        """No corner."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros((2, 0)), np.zeros(0))


def seen_from(camera: Camera, pose: CameraPose, corners: "Corners | KnownCorners | None") -> Seen:
    """The corners as rays in the reported attitude's axes; those that the lens' model can't invert are left out."""
    corners = corners or Corners.none()
    n = corners.names.size
    if n == 0:
        return Seen(corners.names, np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))
    steps = _STEP_PX * np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])
    pixels = (corners.pixels[:, :, None] + steps[:, None]).reshape(2, -1)
    rays = camera.rays(pixels).T.reshape(n, 5, 3)
    back_px, _ = camera.project(rays[:, 0].T)
    with np.errstate(invalid="ignore"):
        good = (np.abs(back_px - corners.pixels).max(axis=0) < _MOST_OFF_PX) & (corners.sigma_px > 0.0)
    by_pixel = np.stack([rays[:, 1] - rays[:, 2], rays[:, 3] - rays[:, 4]], axis=2) / (2.0 * _STEP_PX)
    ray = rays[:, 0]
    right = np.cross(ray, [0.0, 1.0, 0.0])
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-6)
    across = np.stack([right, np.cross(right, ray)], axis=1)
    J = across @ by_pixel
    with np.errstate(invalid="ignore"):
        area = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        good &= np.isfinite(J).all(axis=(1, 2)) & (np.abs(area) > _LEAST_AREA)
    J, across, ray = J[good], across[good], ray[good]
    whiten = np.linalg.solve(J, across) / corners.sigma_px[good, None, None]
    rays_enu = ray @ pose.R_cam_from_enu
    height_m = max(float(pose.position_enu_m[2]), _LEAST_HEIGHT_M)
    depth_m = height_m / np.maximum(-rays_enu[:, 2], _LEAST_DOWN)
    return Seen(corners.names[good], rays_enu, whiten @ pose.R_cam_from_enu, depth_m)


def mended(camera: Camera, focal: float, radial: float) -> Camera:
    """The camera with a focal length longer by a share, and a first radial coefficient that is more.

    Where the lens' model takes no such coefficient, or not so much of it, only the focal length.
    """
    longer = replace(camera, fx=camera.fx * (1.0 + focal), fy=camera.fy * (1.0 + focal))
    if camera.model != "brown-conrady" or not radial:
        return longer
    first, *others = camera.distortion or (0.0,) * 4
    try:
        return replace(longer, distortion=(first + radial, *others))
    except ValueError:
        return longer
