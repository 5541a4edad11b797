"""What a cloud of equally likely particles says: ellipse, intervals, the object's extent."""

import math

import numpy as np

from distloc.snapshot import Float32Array
from distloc.types import Ellipse, FloatArray

LEVEL = 0.95  # of every ellipse and interval that is reported; the three below belong to it
TAILS = (0.025, 0.975)  # what lies below an interval's ends
NORMAL95 = 1.960  # 97.5 % quantile of the normal distribution
CHI2_95 = 5.991  # 95 % quantile of chi squared with two degrees of freedom
NORMAL90 = 1.644854  # 95 % quantile of the normal distribution: 90 % lie within as many standard deviations
_COSINES2 = np.cos((np.arange(64) + 0.5) * (np.pi / 128)) ** 2
_NEWTON_STEPS = 7


def credible_ellipse(points_en_m: FloatArray, share: float = LEVEL) -> Ellipse:
    """The ellipse shaped by the covariance of points (2, N), east and north, that holds `share` of them.

    A cloud without extent in one direction gets a semi-axis of 1 mm there.
    """
    centred = points_en_m - points_en_m.mean(axis=1, keepdims=True)
    weights = np.full(centred.shape[1], 1.0 / centred.shape[1])
    return weighted_ellipse(centred, weights, centred @ centred.T / centred.shape[1], share)


def weighted_ellipse(centred_en_m: FloatArray, weights: FloatArray, covariance_m2: FloatArray, share: float) -> Ellipse:
    """The same for offsets (2, N) from the mean with weights (N,) that sum to 1, and the shape (2, 2) given."""
    values, vectors = np.linalg.eigh(covariance_m2)
    values = np.maximum(values, 1e-8)
    squared = (np.square(vectors.T @ centred_en_m) / values[:, None]).sum(axis=0)
    factor = max(float(np.sqrt(weighted_quantile(squared, weights, share))), 1e-3)
    east, north = vectors[:, 1]
    major, minor = np.sqrt(values[1]) * factor, np.sqrt(values[0]) * factor
    return Ellipse(max(float(major), 1e-3), max(float(minor), 1e-3), float(np.arctan2(east, north) % np.pi))


def weighted_quantile(values: FloatArray, weights: FloatArray, share: float) -> float:
    """The value (of N) at or under which a share of the weights (N,), which sum to 1, lies; between two of them linear.

    Each weight lies about its value, so that with equal weights it is Hazen's quantile.
    """
    order = np.argsort(values)
    middle = np.cumsum(weights[order]) - 0.5 * weights[order]
    return float(np.interp(share, middle, values[order]))


def equal_parts(values: Float32Array, weights: Float32Array) -> Float32Array:
    """Of k targets' samples (rows, k, m) with weights (k, m) as many columns again, equally likely, by their weights.

    Systematic, with the same offset always: the same sample gives the same.
    """
    k, m = weights.shape
    sums = np.cumsum(weights, axis=1, dtype=np.float64)
    ends = np.ceil(sums * (m / np.maximum(sums[:, -1:], 1e-30)) - 0.5).astype(np.intp)
    ends[:, -1] = m
    ends += m * np.arange(k)[:, None]
    chosen = np.repeat(np.arange(k * m), np.diff(ends.ravel(), prepend=0))
    return values.reshape(-1, k * m).take(chosen, axis=1, mode="clip").reshape(-1, k, m)  # clip: it needs no buffer


def quantiles(values: Float32Array, shares: tuple[float, ...]) -> FloatArray:
    """Of equally likely values (k, m), for each share (k,): Hazen's, between two of them linear. (shares, k)."""
    m = values.shape[1]
    ranks = [min(max(share * m - 0.5, 0.0), m - 1.0) for share in shares]
    lows = [min(int(rank), max(m - 2, 0)) for rank in ranks]
    # to sort takes less than to part twice; of what comes after a part the least is the next one
    ordered = np.partition(values, lows[0], axis=1) if len(lows) == 1 else np.sort(values, axis=1)
    found = np.empty((len(shares), values.shape[0]))
    for row, rank, low in zip(found, ranks, lows, strict=True):
        first, second = ordered[:, low], ordered[:, min(low + 1, m - 1) :].min(axis=1)
        row[:] = first + (rank - low) * (second - first)
    return found


def ellipse_holds(ellipse: Ellipse, offset_en_m: FloatArray) -> bool:
    """Whether a point (2,) at this offset east and north of the ellipse's centre lies inside it."""
    along = np.array([np.sin(ellipse.azimuth_rad), np.cos(ellipse.azimuth_rad)])
    across = np.array([along[1], -along[0]])
    major, minor = along @ offset_en_m / ellipse.semi_major_m, across @ offset_en_m / ellipse.semi_minor_m
    return bool(major**2 + minor**2 <= 1.0)


def circular_error90_m(covariance_en_m2: FloatArray) -> float:
    """CE90: the radius of the circle about the mean that holds 90 % of a normal distribution, covariance (2, 2).

    With the ellipse made round, the circle's edge lies at r / sqrt(a cos^2 phi + b sin^2 phi) on the ray at phi, with
    the eigenvalues a and b, and exp(-half its square) beyond it: smooth in phi, so that even rays give its mean to
    machine precision. As a function of r^2 that is convex, and Newton's steps from a line's radius (b = 0), the least
    that can be, only rise. NaN for what is no covariance.
    """
    if not np.isfinite(covariance_en_m2).all():
        return math.nan
    least, most = np.linalg.eigvalsh(covariance_en_m2)
    if most <= 0.0 or least < -1e-9 * most:
        return math.nan
    variances = most * _COSINES2 + max(least, 0.0) * (1.0 - _COSINES2)
    squared_m2 = NORMAL90**2 * most
    for _ in range(_NEWTON_STEPS):
        beyond = np.exp(-0.5 * squared_m2 / variances)
        squared_m2 += (beyond.mean() - 0.1) / (0.5 * beyond / variances).mean()
    return math.sqrt(squared_m2)


def blurred(ellipse: Ellipse, covariance_m2: FloatArray) -> Ellipse:
    """A 95 % ellipse with an independent error more, of this covariance (2, 2) east and north."""
    sine, cosine = math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)
    major_m2, minor_m2 = ellipse.semi_major_m**2, ellipse.semi_minor_m**2
    (east_m2, mixed_m2), (_, north_m2) = (CHI2_95 * covariance_m2).tolist()
    east_m2 += major_m2 * sine**2 + minor_m2 * cosine**2
    north_m2 += major_m2 * cosine**2 + minor_m2 * sine**2
    mixed_m2 += (major_m2 - minor_m2) * sine * cosine
    middle_m2, half_m2 = (east_m2 + north_m2) / 2.0, math.hypot((north_m2 - east_m2) / 2.0, mixed_m2)
    azimuth_rad = math.atan2(2.0 * mixed_m2, north_m2 - east_m2) / 2.0 % math.pi
    return Ellipse(math.sqrt(middle_m2 + half_m2), math.sqrt(max(middle_m2 - half_m2, 1e-6)), azimuth_rad)


def grown(ellipse: Ellipse, margin_m: float) -> Ellipse:
    """The ellipse with both semi-axes longer by `margin_m`: it holds every object of that radius centred inside."""
    return Ellipse(ellipse.semi_major_m + margin_m, ellipse.semi_minor_m + margin_m, ellipse.azimuth_rad)
