"""How likely a target stands, creeps or is driven, and what that makes of its place; its track has one.

What has less than one in twenty to it does not widen what holds 95 %; each of the others is inside.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from distloc.sights.sights import Ray
from distloc.tracks.motion.bearings import ENOUGH, TIME, Bearings
from distloc.tracks.motion.fit import HYPOTHESES, MOTIONS, SCALES, Appearance, Fit, fitted
from distloc.types import FloatArray, PoseErrors

Verdict = Literal["fixed", "unresolved", "moving"]

_JUDGED_STEPS = 5  # sightings after which it is judged anew
_CONTRADICTS = 9.21  # a squared distance of 2 degrees of freedom: more in 1 of 100 by chance
COUNTS = 0.05  # what is less likely is left out,
_IS_SO = 0.95  # and what is likelier is so
_DRIVEN = 0.5  # to one that it stands or creeps, before more is known than that there is smoke or dust
_HELD = 0.5  # of the square of how far each is off the middle counts as its variance: the ellipse holds it
_FRONT_FIRST, _FRONT_LATER, _FRONT_S = 0.045, 0.35, 600.0  # how likely a front creeps, and after so long a time


class Motion:
    """The bearings; of the fit's hypotheses probabilities (h,), places, velocities (h, 2), covariances (h, 2, 2).

    `by_scale` (s,) is the logarithm of how well each of the fit's `SCALES` explains the bearings, whatever moves.
    """

    def __init__(self, bearings: FloatArray | None = None, first_s: float = 0.0) -> None:
        self.bearings, self.first_s = Bearings(bearings), first_s
        self.steps = 0 if bearings is None else _JUDGED_STEPS  # since it was judged last
        self.is_judged = False
        self.probability = np.zeros(HYPOTHESES)
        self.probability[0] = 1.0
        self.by_scale = np.zeros(len(SCALES))
        self.place_m, self.velocity_mps = np.zeros((HYPOTHESES, 2)), np.zeros((HYPOTHESES, 2))
        self.place_m2 = np.zeros((HYPOTHESES, 2, 2))
        self.stamp_s = self.judged_s = first_s

    @property
    def is_due(self) -> bool:
        """Whether it is to be judged."""
        return self.bearings.count >= ENOUGH and self.steps >= _JUDGED_STEPS

    @property
    def is_awaited(self) -> bool:
        """Whether its bearings would do, and it was never judged: where there are many it has its turn later."""
        return self.is_due and not self.is_judged

    @property
    def of_motions(self) -> FloatArray:
        """The probabilities (3,) of the fit's `SPEEDS_MPS`."""
        return np.asarray(self.probability.reshape(-1, MOTIONS).sum(axis=0))

    @property
    def verdict(self) -> Verdict:
        """Whether what was seen stands, a creeping front included."""
        driven = self.of_motions[2]
        return "fixed" if driven < COUNTS else "moving" if driven > _IS_SO else "unresolved"

    def saw(self, ray: Ray, errors: PoseErrors, white_rad: float, target_enu_m: FloatArray) -> None:
        """A sighting of a target that is about there (3,)."""
        if self.bearings.count == 0:
            self.first_s = ray.pose.stamp_s
        self.bearings.add(ray, errors, white_rad, target_enu_m)
        self.stamp_s, self.steps = ray.pose.stamp_s, self.steps + 1

    def take(self, fit: Fit, index: int, may_drive: bool, scales: FloatArray) -> None:
        """Judge it by one of the targets that were fitted, and how likely each scale is (s,) before.

        Of what has no known height none is taken to be driven.
        """
        watched = 1.0 - np.exp(-(((self.stamp_s - self.first_s) / _FRONT_S) ** 4))
        creeps = _FRONT_FIRST + _FRONT_LATER * watched
        odds = np.array([1.0 - creeps, creeps, _DRIVEN if may_drive else 1e-9])
        by_both = np.log(odds) + fit.log_evidence[index].reshape(-1, MOTIONS)
        self.by_scale = np.logaddexp.reduce(by_both, axis=1)
        log = (by_both + np.log(scales)[:, None]).ravel()
        likely = np.exp(log - log.max())
        self.probability = likely / likely.sum()
        self.place_m, self.velocity_mps = fit.place_m[index], fit.velocity_mps[index]
        self.place_m2, self.steps = fit.place_m2[index], 0
        self.judged_s, self.is_judged = float(self.bearings.held[self.bearings.count - 1, TIME]), True


def judge(
    motions: Sequence[Motion], about_m: FloatArray, aim_rad: FloatArray, appearance: Appearance, scales: FloatArray
) -> None:
    """By all their bearings, from about (k, 2), and by what they look like; the aim errs by `aim_rad` (k,).

    `scales` (k, s) is how likely each is of the heading's error, but for these bearings.
    """
    fit = fitted([one.bearings for one in motions], about_m, aim_rad, appearance)
    for index, motion in enumerate(motions):
        motion.take(fit, index, bool(appearance.height_rad[index] > 0.0), scales[index])


def mixed(
    motions: Sequence[Motion], stamp_s: float, mean_m: FloatArray, covariance_m2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the motions make of k places that hold if they stand (k, 2), known to (k, 2, 2): shifts, and what is added.

    The middle is the mean of what is likely enough; the ellipse holds each of these, not only most of their mixture.
    Where a filter began anew and contradicts all the bearings together, they are as likely as it.
    """
    shift, added = np.zeros_like(mean_m), np.zeros_like(covariance_m2)
    judged = [index for index, one in enumerate(motions) if one.is_judged]
    if not judged:
        return shift, added
    some = [motions[index] for index in judged]
    share = np.array([one.probability for one in some])
    stands_m, stands_m2 = np.array([one.place_m[0] for one in some]), np.array([one.place_m2[0] for one in some])
    apart_m = stands_m - mean_m[judged]
    squared = (apart_m * np.linalg.solve(stands_m2 + covariance_m2[judged], apart_m[:, :, None])[:, :, 0]).sum(axis=1)
    is_apart = (squared > _CONTRADICTS) & (share[:, 0] >= COUNTS)
    told = np.flatnonzero(is_apart | (share[:, 1:].max(axis=1) >= COUNTS)).tolist()
    if not told:
        return shift, added
    share = np.concatenate([share, np.where(is_apart, share[:, 0], 0.0)[:, None]], axis=1)[told]
    share *= share >= COUNTS
    share /= share.sum(axis=1, keepdims=True)
    some, at = [some[index] for index in told], [judged[index] for index in told]
    # a clock that went back says nothing of how far it moved since
    since_s = np.array([max(stamp_s - one.judged_s, 0.0) for one in some])[:, None, None]
    moved_m = np.array([one.place_m for one in some]) + since_s * np.array([one.velocity_mps for one in some])
    place_m = np.concatenate([moved_m, stands_m[told, None]], axis=1)
    place_m2 = np.concatenate([np.array([one.place_m2 for one in some]), stands_m2[told, None]], axis=1)
    place_m[:, 0], place_m2[:, 0] = mean_m[at], covariance_m2[at]
    middle_m = (share[:, :, None] * place_m).sum(axis=1)
    off_m = place_m - middle_m[:, None]
    squared_m2 = off_m[..., None] * off_m[..., None, :]
    covering_m2 = (share[:, :, None, None] * (place_m2 + squared_m2)).sum(axis=1)
    for index in np.flatnonzero(share.any(axis=0)):
        lacking_m2 = _positive(place_m2[:, index] + _HELD * squared_m2[:, index] - covering_m2)
        covering_m2 += np.where(share[:, index, None, None] > 0.0, lacking_m2, 0.0)
    shift[at] = middle_m - mean_m[at]
    added[at] = _positive(covering_m2 - covariance_m2[at])
    return shift, added


def _positive(symmetric: FloatArray) -> FloatArray:
    """Matrices (k, 2, 2) without what is negative of them."""
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None]) @ vectors.swapaxes(1, 2))
