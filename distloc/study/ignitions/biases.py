"""What each mount's heading errs by, as other fires of known place show it: never by the fire that is scored.

A platform's look at a fire is beside its ignition by the mount's bias, which lasts but not for ever (somebody turns the
camera), and by what is that fire's own: the lens, smoke that leans, a record that is not exact. How large each is, and
how long a bias lasts, is not known: all on a grid are weighed by how likely they make the other fires' looks.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.study.ignitions.known import Look
from distloc.types import BoolArray, FloatArray

_BIASES_RAD = tuple(np.radians([0.3, 0.6, 1.2, 2.5, 5.0, 10.0]).tolist())
_OWN_RAD = tuple(np.radians([0.15, 0.3, 0.6, 1.2, 2.5, 5.0]).tolist())
_LASTS_S = tuple(86_400.0 * days for days in (3.0, 30.0, 300.0, 10_000.0))
_OWN_BEFORE_RAD, _WIDE = math.radians(0.6), 1.0  # the fire's own part before anything is seen, and a logarithm about it
_LEAST_BIAS_RAD = math.radians(0.1)
_OUTLIER = 3.5  # standard deviations beyond which a look is at something else


@dataclass(frozen=True, slots=True)
class Bias:
    """What a platform's heading errs by, to the right, at a fire that is not among the `fires` that tell it."""

    mean_rad: float
    sigma_rad: float
    fires: int


@dataclass(frozen=True, slots=True)
class _Sizes:
    bias_rad: float
    own_rad: float
    lasts_s: float
    log_share: float


def biases_for(platforms: Sequence[str], stamp_s: float, others: Sequence[Look], told_rad: float) -> dict[str, Bias]:
    """Each platform's bias at a time, by looks at other fires. `told_rad` is about how large biases are said to be.

    `sigma_rad` has what is a fire's own, too, but for its smoke: what a look at one more fire will be beside it.
    """
    sizes = _sizes(told_rad)
    kept = np.ones(len(others), np.bool_)
    for _ in range(2):
        used = [look for look, is_kept in zip(others, kept, strict=True) if is_kept]
        weights = _weights(sizes, used)
        beyond = _beyond(sizes, weights, used)
        if not beyond.any():
            break
        kept[np.flatnonzero(kept)[beyond]] = False
    used = [look for look, is_kept in zip(others, kept, strict=True) if is_kept]
    weights = _weights(sizes, used)
    return {name: _mixed(sizes, weights, [one for one in used if one.platform == name], stamp_s) for name in platforms}


def _sizes(told_rad: float) -> list[_Sizes]:
    return [
        _Sizes(bias, own, lasts, _log_normal(bias, max(told_rad, _LEAST_BIAS_RAD)) + _log_normal(own, _OWN_BEFORE_RAD))
        for bias in _BIASES_RAD
        for own in _OWN_RAD
        for lasts in _LASTS_S
    ]


def _log_normal(value: float, about: float) -> float:
    return -0.5 * (math.log(value / about) / _WIDE) ** 2


def _weights(sizes: Sequence[_Sizes], looks: Sequence[Look]) -> FloatArray:
    """How likely each of the sizes is, before and by the looks (S,)."""
    by_platform: dict[str, list[Look]] = {}
    for look in looks:
        by_platform.setdefault(look.platform, []).append(look)
    logs = np.array([one.log_share for one in sizes])
    for own in by_platform.values():
        covariance = _covariances(sizes, own)
        beside = np.array([look.beside_rad for look in own])
        _, log_det = np.linalg.slogdet(covariance)
        solved = np.linalg.solve(covariance, np.broadcast_to(beside[:, None], (len(sizes), len(own), 1)))
        logs += -0.5 * log_det - 0.5 * np.einsum("i,sij->s", beside, solved)
    shares = np.exp(logs - logs.max())
    return np.asarray(shares / shares.sum())


def _covariances(sizes: Sequence[_Sizes], looks: Sequence[Look]) -> FloatArray:
    """Of one platform's looks (S, n, n)."""
    stamps = np.array([look.stamp_s for look in looks])
    smoke = np.array([look.smoke_m / max(look.range_m, 1.0) for look in looks])
    apart_s = np.abs(stamps[:, None] - stamps[None])
    bias, own, lasts = (np.array([getattr(one, name) for one in sizes]) for name in ("bias_rad", "own_rad", "lasts_s"))
    kept = np.exp(-apart_s[None] / lasts[:, None, None])
    return np.asarray(
        np.square(bias)[:, None, None] * kept
        + (np.square(own)[:, None] + np.square(smoke))[:, :, None] * np.eye(len(looks))
    )


def _mixed(sizes: Sequence[_Sizes], weights: FloatArray, looks: Sequence[Look], stamp_s: float) -> Bias:
    """The mean and standard deviation over all sizes."""
    own = np.array([one.own_rad for one in sizes])
    mean, variance = np.zeros(len(sizes)), np.square([one.bias_rad for one in sizes])
    if looks:
        apart_s = np.abs(np.array([look.stamp_s for look in looks]) - stamp_s)
        lasts = np.array([one.lasts_s for one in sizes])
        shared = variance[:, None] * np.exp(-apart_s[None] / lasts[:, None])  # (S, n)
        gain = np.linalg.solve(_covariances(sizes, looks), shared[:, :, None])[:, :, 0]
        mean = gain @ np.array([look.beside_rad for look in looks])
        variance = variance - np.einsum("si,si->s", gain, shared)
    middle = float(weights @ mean)
    spread = float(weights @ (variance + np.square(own) + np.square(mean - middle)))
    return Bias(middle, math.sqrt(spread), len(looks))


def _beyond(sizes: Sequence[_Sizes], weights: FloatArray, looks: Sequence[Look]) -> BoolArray:
    """Which looks (n,) the platform's other ones, and how large all are, make all but impossible."""
    found = np.zeros(len(looks), np.bool_)
    for i, look in enumerate(looks):
        rest = [one for one in looks if one.platform == look.platform and one is not look]
        bias = _mixed(sizes, weights, rest, look.stamp_s)
        sigma_rad = math.hypot(bias.sigma_rad, look.smoke_m / max(look.range_m, 1.0))
        found[i] = abs(look.beside_rad - bias.mean_rad) > _OUTLIER * sigma_rad
    return found
