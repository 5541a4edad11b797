"""How likely a target stands, creeps or is driven, and what that makes of its place; its track has one.

On one course the bearings can't tell (fit.py), so what a plume looks like must: dust is low and drawn out, smoke rises.
What has less than one in twenty to it does not widen what holds 95 %.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from distloc.sights.sights import Ray
from distloc.tracks.motion.bearings import Bearings
from distloc.tracks.motion.fit import Fit, fitted
from distloc.types import FloatArray, PoseErrors

Verdict = Literal["fixed", "unresolved", "moving"]

_LEAST_BEARINGS = 6
_JUDGED_STEPS = 5  # sightings after which it is judged anew
_COUNTS = 0.05  # what is less likely is left out,
_IS_SO = 0.95  # and what is likelier is so
_DUST_M, _STEEPNESS, _MOST_ODDS = 66.0, 9, 2.0  # of a height it is as likely dust as smoke, where as wide as high
_FRONT_FIRST, _FRONT_LATER, _FRONT_S = 0.045, 0.35, 600.0  # how likely a front creeps, and after so long a time


class Motion:
    """The bearings; probabilities (3,) of the fit's `SPEEDS_MPS`, places, velocities (3, 2), covariances (3, 2, 2)."""

    def __init__(self, bearings: FloatArray | None = None, first_s: float = 0.0) -> None:
        self.bearings, self.first_s = Bearings(bearings), first_s
        self.steps = 0 if bearings is None else _JUDGED_STEPS  # since it was judged last
        self.probability = np.array([1.0, 0.0, 0.0])
        self.place_m, self.velocity_mps = np.zeros((3, 2)), np.zeros((3, 2))
        self.place_m2 = np.zeros((3, 2, 2))
        self.stamp_s = self.judged_s = first_s

    @property
    def is_due(self) -> bool:
        """Whether it is to be judged."""
        return self.bearings.count >= _LEAST_BEARINGS and self.steps >= _JUDGED_STEPS

    @property
    def verdict(self) -> Verdict:
        """Whether what was seen stands, a creeping front included."""
        driven = self.probability[2]
        return "fixed" if driven < _COUNTS else "moving" if driven > _IS_SO else "unresolved"

    def saw(self, ray: Ray, errors: PoseErrors, white_rad: float) -> None:
        """A sighting."""
        if self.bearings.count == 0:
            self.first_s = ray.pose.stamp_s
        self.bearings.add(ray, errors, white_rad)
        self.stamp_s, self.steps = ray.pose.stamp_s, self.steps + 1

    def take(self, fit: Fit, index: int, dust: float) -> None:
        """Judge it by one of the targets that were fitted, and the odds that it is dust by its looks."""
        watched = 1.0 - np.exp(-(((self.stamp_s - self.first_s) / _FRONT_S) ** 4))
        creeps = _FRONT_FIRST + _FRONT_LATER * watched
        odds = np.array([1.0 - creeps, creeps, max(dust, 1e-9)])
        log = np.log(odds) + fit.log_evidence[index]
        likely = np.exp(log - log.max())
        self.probability = likely / likely.sum()
        self.place_m, self.velocity_mps = fit.place_m[index], fit.velocity_mps[index]
        self.place_m2, self.steps = fit.place_m2[index], 0
        self.judged_s = self.stamp_s


def dust_odds(size_m: FloatArray) -> float:
    """That what looks so wide and high (2,) is dust that something raises which drives, to one that it is smoke.

    Of a size that nobody knows, 0, nothing is held against it.
    """
    width_m, height_m = size_m.tolist()
    if height_m <= 0.0:
        return 0.0
    return float(min((_DUST_M / height_m) ** _STEEPNESS * (width_m / height_m) ** 2, _MOST_ODDS))


def judge(motions: Sequence[Motion], about_m: FloatArray, aim_rad: FloatArray, sizes_m: FloatArray) -> None:
    """By all their bearings, from about (k, 2); the aim errs by `aim_rad` (k,); they are so wide and high (k, 2)."""
    fit = fitted([one.bearings for one in motions], about_m, aim_rad)
    for index, (motion, size_m) in enumerate(zip(motions, sizes_m, strict=True)):
        motion.take(fit, index, dust_odds(size_m))


def mixed(
    motions: Sequence[Motion], stamp_s: float, mean_m: FloatArray, covariance_m2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the motions make of k places that hold if they stand (k, 2), known to (k, 2, 2): shifts, and what is added.

    The moments of the mixture of what is likely enough.
    """
    shift, added = np.zeros_like(mean_m), np.zeros_like(covariance_m2)
    told = [index for index, one in enumerate(motions) if one.probability[1:].max() >= _COUNTS]
    if not told:
        return shift, added
    some = [motions[index] for index in told]
    share = np.array([one.probability for one in some])
    share[:, 1:] *= share[:, 1:] >= _COUNTS
    share /= share.sum(axis=1, keepdims=True)
    since_s = np.array([stamp_s - one.judged_s for one in some])[:, None, None]
    place_m = np.array([one.place_m for one in some]) + since_s * np.array([one.velocity_mps for one in some])
    place_m2 = np.array([one.place_m2 for one in some])
    place_m[:, 0], place_m2[:, 0] = mean_m[told], covariance_m2[told]
    middle_m = (share[:, :, None] * place_m).sum(axis=1)
    off_m = place_m - middle_m[:, None]
    mixture = (share[:, :, None, None] * (place_m2 + off_m[..., None] * off_m[..., None, :])).sum(axis=1)
    values, vectors = np.linalg.eigh(mixture - covariance_m2[told])
    shift[told] = middle_m - mean_m[told]
    added[told] = vectors * np.maximum(values, 0.0)[:, None] @ vectors.swapaxes(1, 2)
    return shift, added
