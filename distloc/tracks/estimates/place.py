"""Where clouds of particles say that targets are: on the map, and from the camera that looks. The tracker asks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distloc.filter.ground import Ground
from distloc.filter.moments import Clouds
from distloc.filter.particles import SAMPLE, Particles
from distloc.filter.uncertainty import LEVEL, NORMAL95, TAILS, blurred, equal_parts, quantiles
from distloc.snapshot import Float32Array
from distloc.tracks.looks.lean import Beside, hidden_of
from distloc.tracks.looks.looks import Looks
from distloc.tracks.motion.motion import Motion, mixed
from distloc.types import Ellipse, FloatArray

_TOGETHER = 8  # targets at a time: what is made of their particles stays in the cache
_MANY = 24  # targets: of each of more than that half a sample is ordered


@dataclass(frozen=True, slots=True)
class Place:
    """The place (3,) and its covariance, the 95 % ellipse about it and the half of the height's 95 %.

    Range and bearing are from the camera: `range95_m` are the 2.5 and 97.5 % quantiles; `bearing_rad` is clockwise from
    north.
    """

    position_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    ellipse95: Ellipse
    vertical95_m: float
    range_m: float
    range95_m: tuple[float, float]
    bearing_rad: float


def beside_of(
    looks: Looks,
    motions: Sequence[Motion],
    clouds: Clouds,
    at: NDArray[np.intp],
    stamp_s: float,
    also_m2: FloatArray,
    ground: Ground,
) -> Beside:
    """From k targets' clouds at these places to their fires; `also_m2` (k, 2, 2) is what else they lack on the map."""
    mean_enu_m, known_m2, rows = clouds.mean_enu_m[at], clouds.covariance_enu_m2[at], looks.latest[at]
    range_m = np.linalg.norm(mean_enu_m - looks.camera_enu_m[rows], axis=1)
    root_m = range_m * np.nan_to_num(looks.root_rad[rows])
    hidden = hidden_of(*looks.leans.of(at), root_m, mean_enu_m, known_m2[:, 2, 2], ground)
    moved_m, widened_m2 = mixed(motions, stamp_s, mean_enu_m[:, :2], known_m2[:, :2, :2])
    hidden.shift_enu_m[:, :2] += moved_m
    return replace(hidden, covariance_m2=hidden.covariance_m2 + also_m2 + widened_m2)


def places_of(particles: Particles, at: NDArray[np.intp], camera_enu_m: FloatArray, beside: Beside) -> list[Place]:
    """Of the k targets at these places, from a camera at (3,); `beside` is what the clouds lack."""
    clouds, also_m2 = particles.clouds, beside.covariance_m2
    mean_offset_enu_m = clouds.mean_enu_m[at] - camera_enu_m
    mean_range_m = np.linalg.norm(mean_offset_enu_m, axis=1)
    offset_enu_m = mean_offset_enu_m + beside.shift_enu_m
    values, vectors = np.linalg.eigh(clouds.covariance_enu_m2[at, :2, :2])
    values = np.maximum(values, 1e-8)
    whiten = vectors.swapaxes(1, 2) / np.sqrt(values)[:, :, None]
    told, most = np.empty((4, at.size)), SAMPLE if at.size <= _MANY else SAMPLE // 2
    for start in range(0, at.size, _TOGETHER):
        some = slice(start, start + _TOGETHER)
        _quantiles(particles, at[some], most, camera_enu_m, whiten[some], told[:, some])
    squared, vertical_m, low_m, high_m = told
    range_m = np.linalg.norm(offset_enu_m, axis=1)
    along = (offset_enu_m[:, :2] / np.maximum(range_m, 1.0)[:, None])[:, None]
    also_m = NORMAL95 * np.sqrt(np.maximum((along @ also_m2 @ along.swapaxes(1, 2))[:, 0, 0], 0.0))
    covariance_enu_m2 = clouds.covariance_enu_m2[at]
    covariance_enu_m2[:, :2, :2] += also_m2
    covariance_enu_m2[:, 2, 2] += np.square(beside.up_sigma_m)
    semi_m = np.maximum(np.sqrt(values) * np.maximum(np.sqrt(squared), 1e-3)[:, None], 1e-3)
    azimuth_rad = np.arctan2(vectors[:, 0, 1], vectors[:, 1, 1]) % np.pi
    nearer_m = np.maximum(range_m - np.hypot(mean_range_m - low_m, also_m), 0.0)
    farther_m = range_m + np.hypot(high_m - mean_range_m, also_m)
    vertical_m = np.hypot(vertical_m, NORMAL95 * beside.up_sigma_m)
    bearing_rad = np.arctan2(offset_enu_m[:, 0], offset_enu_m[:, 1]) % (2.0 * np.pi)
    return [
        Place(
            position_enu_m=camera_enu_m + offset_enu_m[i],
            covariance_enu_m2=covariance_enu_m2[i],
            ellipse95=blurred(Ellipse(float(semi_m[i, 1]), float(semi_m[i, 0]), float(azimuth_rad[i])), also_m2[i]),
            vertical95_m=float(vertical_m[i]),
            range_m=float(range_m[i]),
            range95_m=(float(nearer_m[i]), float(farther_m[i])),
            bearing_rad=float(bearing_rad[i]),
        )
        for i in range(at.size)
    ]


def _quantiles(
    particles: Particles,
    at: NDArray[np.intp],
    most: int,
    camera_enu_m: FloatArray,
    whiten: FloatArray,
    out: FloatArray,
) -> None:
    """The rows of `out` (4, k): what `LEVEL` of the squared distances on the map, by `whiten` (k, 2, 2), lies under.

    And of the height over or under the mean; the `TAILS` of the range. By samples of `most` particles.
    """
    mean_enu_m = particles.clouds.mean_enu_m[at]
    x, weights = particles.sampled(at, most, rows=3)
    centred_m = x + (particles.origin_enu_m[at] - mean_enu_m).astype(np.float32)[:, :, None]
    from_camera_m = centred_m + (mean_enu_m - camera_enu_m).astype(np.float32)[:, :, None]
    on_map = whiten.astype(np.float32) @ centred_m[:, :2]
    parts = np.empty((3, *weights.shape), np.float32)
    parts[0], parts[1] = _squared(on_map), np.abs(centred_m[:, 2])
    np.sqrt(_squared(from_camera_m), out=parts[2])
    squared, vertical_m, ranges_m = equal_parts(parts, weights)
    out[0], out[1], out[2:] = quantiles(squared, (LEVEL,)), quantiles(vertical_m, (LEVEL,)), quantiles(ranges_m, TAILS)


def _squared(vectors: Float32Array) -> Float32Array:
    """Squared lengths (k, n) of vectors (k, d, n)."""
    return np.asarray(np.einsum("kdn,kdn->kn", vectors, vectors))
