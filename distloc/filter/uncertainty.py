"""What a cloud of equally likely particles says: ellipse, intervals, the object's extent."""

import math

import numpy as np

from distloc.snapshot import Float32Array
from distloc.types import Ellipse, FloatArray

LEVEL = 0.95  # of every ellipse and interval that is reported; the three below belong to it
TAILS = (0.025, 0.975)  # what lies below an interval's ends
NORMAL95 = 1.960  # 97.5 % quantile of the normal distribution
CHI2_95 = 5.991  # 95 % quantile of chi squared with two degrees of freedom
NORMAL90 = 1.644853  # 95 % quantile of the normal distribution: 90 % lie so many sigmas or less from the mean


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


def ce90_m(covariance_m2: FloatArray) -> float:
    """CE90: the radius of the circle about the estimate that holds 90 % of a normal error of this covariance (2, 2).

    Exact, where 2.146 of a mean sigma is not: in elliptical polar coordinates the probability outside is the mean over
    the angle t of exp(-R^2 / 2 v), v = sigma1^2 cos^2 t + sigma2^2 sin^2 t, whose root R Newton's steps find from below
    (from 1.645 sigma1, where there is no minor axis, the probability inside is concave). NaN where it is not finite.
    """
    if not np.isfinite(covariance_m2).all():
        return math.nan
    minor_m2, major_m2 = np.maximum(np.linalg.eigvalsh(covariance_m2), 0.0).tolist()
    if major_m2 == 0.0:
        return 0.0
    angles_rad = (np.arange(64) + 0.5) * (np.pi / 128.0)
    variances = np.cos(angles_rad) ** 2 + minor_m2 / major_m2 * np.sin(angles_rad) ** 2
    radius = NORMAL90
    for _ in range(6):
        outside = np.exp(-0.5 * radius**2 / variances)
        radius += float((outside.mean() - 0.1) / (radius * (outside / variances).mean()))
    return radius * math.sqrt(major_m2)
