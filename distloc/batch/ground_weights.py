"""What the ground says of where a target can be: on it in plain view, or hidden, its smoke over a crest.

Along a line of sight the ground under a target is as likely at each range's logarithm. Its visible foot is then either
on that ground, where nothing nearer hides it, or, where the ground lies hidden, on the line of the crest that hides it,
as smoke rises until it is seen; the deeper it must have risen the less likely.
"""

import numpy as np

from distloc.batch.posterior import LogWeights
from distloc.filter.ground import GridGround, Ground, NoGround
from distloc.geometry.earth import lift_m
from distloc.types import FloatArray

_SHARES = np.linspace(0.0125, 0.975, 78)  # of the way to a target, where ground may stand in the line of sight
_RISE_M = 500.0  # smoke is seen at the lowest over crests by so much, one standard deviation
_UNKNOWN_RELIEF_M = 500.0  # where the map has nothing
_LOG_ROOT = 0.5 * np.log(2.0 * np.pi)


def ground_weights(ground: Ground, camera_enu_m: FloatArray) -> LogWeights | None:
    """The log of how likely points (K, 3) are to be a target that the camera (3,) sees; None without a ground."""
    if isinstance(ground, NoGround):
        return None

    def log_weights(points_enu_m: FloatArray) -> FloatArray:
        east_m, north_m, up_m = points_enu_m.T
        log_range = np.log(np.maximum(np.linalg.norm(points_enu_m - camera_enu_m, axis=1), 1e-3))
        height_m, is_known = ground.heights_m(east_m, north_m)
        ground_m = np.where(is_known, height_m, camera_enu_m[2])
        ground_sigma_m = np.where(is_known, ground.sigmas_m(east_m, north_m), _UNKNOWN_RELIEF_M)
        log_weight = _log_normal(up_m - ground_m, ground_sigma_m)
        if isinstance(ground, GridGround):
            line_m, sigma_m = _crest_line(ground, camera_enu_m, points_enu_m)
            in_view = log_weight + _log_over((up_m - line_m) / sigma_m)
            is_hidden = _log_over((line_m - ground_m) / np.where(is_known, sigma_m, _UNKNOWN_RELIEF_M))
            over_crest = _log_normal(up_m - line_m, sigma_m) + is_hidden
            over_crest -= 0.5 * np.square((up_m - ground_m) / _RISE_M)
            log_weight = np.logaddexp(in_view, over_crest)
        return np.asarray(log_range + log_weight)

    return log_weights


def _crest_line(
    ground: GridGround, camera_enu_m: FloatArray, points_enu_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How high over each point (K, 3) a line of sight passes that grazes the highest crest before it, and its sigma.

    It is bent as light is: of the lift at its end, a share s of the way has s^2.
    """
    best_m = np.full(len(points_enu_m), -np.inf)  # of lines a standard deviation lower: near ground is little to go by
    line_m, sigma_m = np.full(len(points_enu_m), -1e6), np.full(len(points_enu_m), ground.sigma_m)
    lifted_m = lift_m(np.hypot(*(points_enu_m - camera_enu_m).T[:2]))
    for share in _SHARES:
        at = camera_enu_m + share * (points_enu_m - camera_enu_m)
        height_m, is_known = ground.heights_m(at[:, 0], at[:, 1])
        over_m = camera_enu_m[2] + (height_m - camera_enu_m[2]) / share - (1.0 - share) * lifted_m
        low_m = over_m - ground.sigma_m / share
        is_higher = is_known & (low_m > best_m)
        best_m = np.where(is_higher, low_m, best_m)
        line_m = np.where(is_higher, over_m, line_m)
        sigma_m = np.where(is_higher, ground.sigma_m / share, sigma_m)
    return line_m, sigma_m


def _log_normal(offset_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    return np.asarray(-0.5 * np.square(offset_m / sigma_m) - np.log(sigma_m) - _LOG_ROOT)


def _log_over(sigmas: FloatArray) -> FloatArray:
    """The log of a normal number's chance to be under `sigmas`, near enough (a logistic curve) and never -infinity."""
    return np.asarray(-np.logaddexp(0.0, -1.702 * sigmas))
