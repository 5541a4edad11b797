"""A cloud of weighed points as an answer: ellipse, intervals, the bearing, and what would make it surer."""

import math
from collections.abc import Sequence

import numpy as np

from distloc.batch.lines import Lines
from distloc.batch.place import Bearing, Further, Place
from distloc.batch.posterior import Cloud
from distloc.batch.scales import Scale, log_share
from distloc.filter.uncertainty import LEVEL, TAILS, blurred, weighted_ellipse, weighted_quantile
from distloc.geometry.geodesy import LocalFrame
from distloc.types import Ellipse, FloatArray, PoseErrors

_BINS = 160  # of log range, in which the parts that hold 95 % are told apart
_VIEW_M = 3_000.0  # at most so far is a further sighting from the target
_LEAST_GAIN = 0.8


def place_of(
    target: str,
    lines: Lines,
    origin: int,
    platforms: tuple[str, ...],
    clouds: Sequence[Cloud],
    scales: Sequence[Scale],
    frame: LocalFrame,
    has_ground: bool,
    errors: PoseErrors,
) -> Place:
    """The answer of one cloud for each size of the white errors, weighed by their evidence."""
    evidence = np.array([cloud.log_evidence + log_share(one) for cloud, one in zip(clouds, scales, strict=True)])
    shares = np.exp(evidence - np.logaddexp.reduce(evidence))
    points = np.concatenate([cloud.points_enu_m for cloud in clouds])
    weights = np.concatenate([share * cloud.weights for share, cloud in zip(shares, clouds, strict=True)])
    is_bounded = all(cloud.is_bounded for cloud, share in zip(clouds, shares, strict=True) if share > 0.02)
    camera = lines.position_enu_m[origin]
    bearing = _bearing(int(lines.index[origin]), points - camera, weights, lines.up[origin], is_bounded, clouds, shares)
    heading_white, scatter = (float(np.sqrt(shares @ np.square([scale[part] for scale in scales]))) for part in (0, 1))
    spread = lines.position_enu_m - lines.position_enu_m.mean(axis=0)
    mean = weights @ points
    covariance = (points - mean).T @ ((points - mean) * weights[:, None])
    own = float(np.square(lines.position_bias_m).max()) * np.eye(3)
    ellipse = position = whole = vertical = further = None
    lat_deg = lon_deg = height_m = None
    if is_bounded:
        position, whole = mean, covariance + own
        ellipse = blurred(weighted_ellipse((points - mean)[:, :2].T, weights, covariance[:2, :2], LEVEL), own[:2, :2])
        low, high = (weighted_quantile(points[:, 2], weights, share) for share in TAILS)
        vertical = math.hypot(0.5 * (high - low), 1.96 * math.sqrt(own[2, 2]))
        lat_deg, lon_deg, height_m = frame.geodetic_from_enu(mean)
        further = _further(mean, whole, lines, errors)
    return Place(
        target=target,
        used=tuple(sorted(lines.index.tolist())),
        platforms=platforms,
        bearing=bearing,
        position_enu_m=position,
        covariance_enu_m2=whole,
        ellipse95=ellipse,
        vertical95_m=vertical,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=height_m,
        baseline_m=2.0 * float(np.linalg.norm(spread, axis=1).max()),
        parallax_rad=_parallax(lines, mean),
        heading_white_rad=heading_white,
        scatter_rad=scatter,
        has_ground=has_ground,
        further=further,
    )


def _bearing(
    index: int,
    offsets_m: FloatArray,
    weights: FloatArray,
    up: FloatArray,
    is_bounded: bool,
    clouds: Sequence[Cloud],
    shares: FloatArray,
) -> Bearing:
    east = np.cross([0.0, 1.0, 0.0], up)
    east /= np.linalg.norm(east)
    azimuths = np.arctan2(offsets_m @ east, offsets_m @ np.cross(up, east))
    middle = math.atan2(float(weights @ np.sin(azimuths)), float(weights @ np.cos(azimuths)))
    beside = (azimuths - middle + np.pi) % (2.0 * np.pi) - np.pi
    low, high = (weighted_quantile(beside, weights, share) for share in TAILS)
    ranges = np.linalg.norm(offsets_m, axis=1)
    if is_bounded:
        parts = _parts(ranges, weights)
        ends = (parts[0][0], parts[-1][1])
    else:
        ends = (min(cloud.reach_m[0] for cloud, share in zip(clouds, shares, strict=True) if share > 0.02), math.inf)
        parts = (ends,)
    return Bearing(index, (middle + 0.5 * (low + high)) % (2.0 * math.pi), 0.5 * (high - low), ends, parts)


def _parts(ranges_m: FloatArray, weights: FloatArray) -> tuple[tuple[float, float], ...]:
    """The fewest ranges that hold 95 %, as intervals; those that all but touch are one."""
    logs = np.log(ranges_m)
    held, edges = np.histogram(logs, _BINS, weights=weights)
    held = np.convolve(held, [0.25, 0.5, 0.25], mode="same")
    order = np.argsort(-held, kind="stable")
    enough = int(np.searchsorted(np.cumsum(held[order]), LEVEL * held.sum())) + 1
    is_in = np.zeros(_BINS, np.bool_)
    is_in[order[:enough]] = True
    parts: list[tuple[float, float]] = []
    for low, high in zip(edges[:-1][is_in].tolist(), edges[1:][is_in].tolist(), strict=True):
        if parts and low - parts[-1][1] < 2.5 * (edges[1] - edges[0]):
            parts[-1] = parts[-1][0], high
        else:
            parts.append((low, high))
    return tuple((math.exp(low), math.exp(high)) for low, high in parts)


def _parallax(lines: Lines, point: FloatArray) -> float:
    """The largest angle between two sightings' directions from the place, by twice that from their mean."""
    towards = point - lines.position_enu_m
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
    first = towards[0]
    farthest = towards[int(np.argmin(towards @ first))]
    return float(np.arccos(np.clip((towards @ farthest).min(), -1.0, 1.0)))


def _further(mean: FloatArray, covariance: FloatArray, lines: Lines, errors: PoseErrors) -> Further | None:
    """A sighting across the ellipse's long axis by a platform like those told; None where it brings little."""
    values, vectors = np.linalg.eigh(covariance[:2, :2])
    long_axis = vectors[:, 1]
    side = np.array([-long_axis[1], long_axis[0]])
    nearest = lines.position_enu_m[int(np.argmin(lines.ranges_m(mean[None])[:, 0]))]
    if side @ (nearest - mean)[:2] < 0.0:
        side = -side
    distance_m = min(_VIEW_M, float(np.linalg.norm(nearest - mean)))
    sigma_m = distance_m * math.hypot(errors.heading_bias_rad, errors.attitude_white_rad)
    after = np.linalg.inv(np.linalg.inv(covariance[:2, :2]) + np.outer(long_axis, long_axis) / max(sigma_m, 0.1) ** 2)
    found = np.linalg.eigvalsh(after)
    if found[1] > _LEAST_GAIN**2 * values[1]:
        return None
    east, north = np.linalg.eigh(after)[1][:, 1]
    axes = np.sqrt(5.991 * found)
    ellipse = Ellipse(float(axes[1]), float(axes[0]), float(np.arctan2(east, north) % np.pi))
    return Further(float(np.arctan2(*side) % (2.0 * np.pi)), distance_m, ellipse)
