"""What a frame has in common: its attitude's own error moves all that is expected in it by the same angle.

By itself each track must allow for that error, and where fires stand closer in the picture than it is large any track
may take its neighbour's segment. Together they tell the error: there is one shift under which most of them are where
they are expected, and by that shift each is then looked for closely.
"""

import numpy as np
from numpy.typing import NDArray

from distloc.filter.bank import Fit
from distloc.filter.platforms import kept_until
from distloc.types import CameraPose, FloatArray, PoseErrors

_TRIED = 48  # pairs whose shift is tried, the surest
_FAR = 9.0  # a squared distance of 2 degrees of freedom: more in 1 of 100; a track that is so far off has no say
_LEAST_RAD = 1e-3  # one standard deviation of what else moves each by itself: roll, for one


def shifted_scores(fit: Fit, by_track: NDArray[np.intp], common: FloatArray) -> FloatArray:
    """What is to be added to the logarithms of the densities (p,) of pairs of tracks and sights, by what others tell.

    `common` (2, 2) is the covariance, right and up in squared tangents, of what all of a frame share. A track's own
    pairs have no say in the shift that is assumed for it, so a lone one is judged as before.
    """
    own = fit.covariance - common + np.square(_LEAST_RAD) * np.eye(2)
    by_own, values = np.linalg.inv(own), fit.innovation
    tried = values[np.argsort(np.trace(own, axis1=1, axis2=2), kind="stable")[:_TRIED]]
    order = np.argsort(by_track, kind="stable")
    tracks, first = np.unique(by_track[order], return_index=True)
    by_common = np.linalg.inv(common + np.square(_LEAST_RAD) * np.eye(2))
    off = values - tried[:, None]
    squared = np.minimum(_squared(off, by_own), _FAR)
    nearest = np.minimum.reduceat(squared[:, order], first, axis=1).sum(axis=1)
    shift = tried[int((nearest + _squared(tried, by_common)).argmin())]
    squared = _squared(values - shift, by_own)
    best = order[[start + int(squared[part].argmin()) for start, part in zip(first, np.split(order, first[1:]), strict=True)]]
    best = best[squared[best] < _FAR]
    weights, at = np.zeros((tracks.size, 2, 2)), np.searchsorted(tracks, by_track[best])
    told = np.zeros((tracks.size, 2))
    weights[at], told[at] = by_own[best], (by_own[best] @ values[best, :, None])[:, :, 0]
    rest = np.linalg.inv(by_common + weights.sum(axis=0) - weights)
    others = (rest @ (told.sum(axis=0) - told)[:, :, None])[:, :, 0]
    of_pair = np.searchsorted(tracks, by_track)
    return _log_density(values - others[of_pair], own + rest[of_pair]) - _log_density(values, fit.covariance)


def drift_of(before_s: float, pose: CameraPose, errors: PoseErrors) -> FloatArray:
    """The covariance (3, 3), about east, north and up, of what is new of the attitude's slow error since a time."""
    if pose.attitude is not None:
        return pose.attitude.new
    kept = float(kept_until(pose.stamp_s, np.array([before_s]), errors.bias_time_constant_s)[0])
    return (1.0 - kept**2) * errors.bias_variance


def _squared(off: FloatArray, inverse: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...i,...ij,...j->...", off, inverse, off))


def _log_density(off: FloatArray, covariance: FloatArray) -> FloatArray:
    return -0.5 * (_squared(off, np.linalg.inv(covariance)) + np.log(np.linalg.det(covariance)))
