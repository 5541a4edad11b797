"""Where the ground is, in the local axes: the optional prior of a target's height. The localizer asks it.

The local frame is a plane that touches the earth at its origin, so level ground falls away from it: a point as high
above the sea as another at the origin is at `up = up_at_origin - d^2 / (R + sqrt(R^2 - d^2))`, d its horizontal
distance from the origin: a circle's sagitta, about d^2 / 2R, which is 7.8 m at 10 km and 71 m at 30 km. Light bends
down with an eighth of that: over a straight line of sight the ground stands higher, by 9 m at 30 km from the camera.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from distloc.filter.start import Prior
from distloc.geometry.earth import EARTH_RADIUS_M, lift_m
from distloc.types import BoolArray, FloatArray

_NOT_ON_GROUND = 0.2  # of the feet seen are above a ridge, or the map is wrong
_SLOPE = 0.08  # a tangent: 4.5 degrees, as hills have on the whole; a sea has 0
_UNKNOWN_RELIEF_M = 500.0  # one standard deviation of heights where nothing is known of the ground

Float32Array = NDArray[np.float32]
Reals = NDArray[np.floating[Any]]


class Ground(Protocol):
    """Heights of the ground, and how sure they are."""

    @property
    def sigma_m(self) -> float:
        """One standard deviation of the target's aim about the ground's height, at the least."""

    def sigmas_m(self, east_m: Reals, north_m: Reals) -> FloatArray:
        """The same (N,) at (east, north), each (N,)."""

    def heights_m(self, east_m: Reals, north_m: Reals) -> tuple[Float32Array, BoolArray]:
        """Up (N,) of the ground under (east, north), each (N,), and where it is known; elsewhere up is 0."""


class NoGround:
    """Knows nothing: the prior is off."""

    sigma_m = float("inf")

    def sigmas_m(self, east_m: Reals, north_m: Reals) -> FloatArray:
        """Infinity (N,)."""
        return np.full(len(east_m), np.inf)

    def heights_m(self, east_m: Reals, north_m: Reals) -> tuple[Float32Array, BoolArray]:
        """Zeros (N,), known nowhere."""
        return np.zeros(len(east_m), np.float32), np.zeros(len(east_m), np.bool_)


class FlatGround:
    """A sea level of its own: the same height above the sea everywhere, `up_m` of it at the frame's origin.

    It is home's, and land is seldom level: the farther from there, the less is known, by `slope` of the way.
    """

    def __init__(self, up_m: float, sigma_m: float, slope: float = _SLOPE) -> None:
        if not np.isfinite(up_m):
            raise ValueError(f"up_m must be finite, got {up_m}")
        if not (np.isfinite(slope) and slope >= 0.0):
            raise ValueError(f"slope must be >= 0 and finite, got {slope}")
        self.up_m, self.sigma_m, self.slope = up_m, _checked_sigma(sigma_m), slope

    def sigmas_m(self, east_m: Reals, north_m: Reals) -> FloatArray:
        """One standard deviation (N,), up to that of unknown relief."""
        slopes_m = np.minimum(self.slope * np.hypot(east_m, north_m), _UNKNOWN_RELIEF_M)
        return np.asarray(np.hypot(self.sigma_m, slopes_m), np.float64)

    def heights_m(self, east_m: Reals, north_m: Reals) -> tuple[Float32Array, BoolArray]:
        """Up (N,), known wherever the place is finite."""
        east, north = np.asarray(east_m, np.float32), np.asarray(north_m, np.float32)
        known = np.isfinite(east) & np.isfinite(north)
        squared = np.where(known, east * east + north * north, np.float32(0.0))
        root = np.sqrt(np.maximum(np.float32(EARTH_RADIUS_M**2) - squared, np.float32(0.0)))
        up = np.float32(self.up_m) - squared / (np.float32(EARTH_RADIUS_M) + root)
        return np.where(known, up, np.float32(0.0)), known


class GridGround:
    """A regular grid of heights, interpolated bilinearly.

    `up_m` (rows, cols): row 0 is the southernmost, column 0 the westernmost, at (west_m, south_m); NaN where not known.
    Its heights are ups in the local frame, so the earth's curvature is in them already (its reader computes each
    node on the ellipsoid; between nodes 50 m apart the curvature is a twentieth of a millimetre). A cell with one
    unknown corner is not known, nor is anything outside the grid.
    """

    def __init__(self, up_m: ArrayLike, west_m: float, south_m: float, step_m: float, sigma_m: float) -> None:
        self.up_m = np.ascontiguousarray(up_m, np.float32)
        if self.up_m.ndim != 2 or min(self.up_m.shape) < 2:
            raise ValueError(f"up_m must be (rows, cols) with 2 or more of each, got {self.up_m.shape}")
        if not (np.isfinite([west_m, south_m, step_m]).all() and step_m > 0.0):
            raise ValueError(f"west_m, south_m must be finite and step_m > 0, got {west_m}, {south_m}, {step_m}")
        self.west_m, self.south_m, self.step_m = west_m, south_m, step_m
        self.sigma_m = _checked_sigma(sigma_m)
        self._flat = self.up_m.reshape(-1)
        self._east = self._flat[1:]

    def sigmas_m(self, east_m: Reals, north_m: Reals) -> FloatArray:
        """The same everywhere (N,)."""
        return np.full(len(east_m), self.sigma_m)

    def heights_m(self, east_m: Reals, north_m: Reals) -> tuple[Float32Array, BoolArray]:
        """Up (N,) and where it is known. Allocates a dozen arrays of N: hand it blocks."""
        rows, cols = self.up_m.shape
        row, on_row = _inside(north_m, self.south_m, self.step_m, rows)
        col, known = _inside(east_m, self.west_m, self.step_m, cols)
        known &= on_row
        i, j = np.minimum(np.floor(row), np.float32(rows - 2)), np.minimum(np.floor(col), np.float32(cols - 2))
        row -= i
        col -= j
        at = i.astype(np.intp) * cols + j.astype(np.intp)
        up = self._between(at, col)
        at += cols
        up += row * (self._between(at, col) - up)
        known &= np.isfinite(up)
        return np.where(known, up, np.float32(0.0)), known

    def _between(self, at: NDArray[np.intp], share: Float32Array) -> Float32Array:
        """Heights a share of the way from node `at` to its eastern neighbour."""
        west = self._flat.take(at, mode="clip")
        west += share * (self._east.take(at, mode="clip") - west)
        return west


def ground_prior(ground: Ground, camera_enu_m: FloatArray, base_tangent: float) -> Prior | None:
    """The heights of a target's foot, `base_tangent` times the distance under its aim point, against the ground's.

    What is seen of a plume may begin above a ridge, and no map is right everywhere: one in five is taken to be
    anywhere within the relief.
    """
    if isinstance(ground, NoGround):
        return None

    def log_weights(points_enu_m: FloatArray) -> FloatArray:
        heights_m, known = ground.heights_m(points_enu_m[0], points_enu_m[1])
        distance_m = np.hypot(*(points_enu_m - camera_enu_m[:, None])[:2])
        foot_m = points_enu_m[2] - base_tangent * distance_m
        above_m = foot_m - heights_m - lift_m(distance_m)
        sigma_m = ground.sigmas_m(points_enu_m[0], points_enu_m[1])
        anywhere = np.minimum(sigma_m / _UNKNOWN_RELIEF_M, 1.0)
        near = (1.0 - _NOT_ON_GROUND) * np.exp(-0.5 * np.square(above_m / sigma_m))
        far = _NOT_ON_GROUND * anywhere * np.exp(-0.5 * np.square(above_m / _UNKNOWN_RELIEF_M))
        return np.asarray(np.log(np.where(known, near + far + 1e-30, anywhere)))

    return log_weights


def _inside(place_m: Reals, start_m: float, step_m: float, nodes: int) -> tuple[Float32Array, BoolArray]:
    """Places in steps from the first node, held to the grid (what is not a number too), and which were on it."""
    steps = (np.asarray(place_m, np.float32) - np.float32(start_m)) * np.float32(1.0 / step_m)
    last = np.float32(nodes - 1)
    known = (steps >= 0.0) & (steps <= last)
    np.fmin(np.fmax(steps, np.float32(0.0), out=steps), last, out=steps)
    return steps, known


def _checked_sigma(sigma_m: float) -> float:
    if not (np.isfinite(sigma_m) and sigma_m > 0.0):
        raise ValueError(f"sigma_m must be > 0 and finite, got {sigma_m}")
    return sigma_m
