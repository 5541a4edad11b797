"""How many times as large as told the heading's slow error is, by the bearings of all targets; the tracker has one.

A compass that wanders shows in each bearing how fast it does, whatever stands there: 32 of them tell 2 degrees from 5.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distloc.tracks.motion.fit import SCALES
from distloc.tracks.motion.motion import COUNTS, Motion
from distloc.types import FloatArray, PoseErrors

_PRIOR = np.array([0.96, 0.03, 0.01])
_LEAST_BEARINGS = 16  # of who has a say: false segments do not last
_AS_MANY = 0.5  # of the bearings of the target seen most: who has as many has a say
_FORGOTTEN = 0.998  # of what others told of it before, a step


class HeadingScale:
    """Probabilities (3,) of the fit's `SCALES`.

    All targets are seen with one compass, and what they tell of it is mostly the same: so their evidence is averaged,
    not added.
    """

    def __init__(self) -> None:
        self.probability = _PRIOR.copy()
        self._bearings = 0.0  # that told

    @property
    def factor(self) -> float:
        """Of what is told, one standard deviation; 1 while it is likely as told."""
        if 1.0 - self.probability[0] < COUNTS:
            return 1.0
        return float(np.sqrt(self.probability @ np.square(SCALES)))

    def scaled(self, errors: PoseErrors) -> PoseErrors:
        """These errors with the heading's as it is likely to be."""
        factor = self.factor
        if factor == 1.0:
            return errors
        return replace(errors, heading_bias_rad=factor * errors.heading_bias_rad, heading_scale=factor)

    def before(self, motion: Motion) -> FloatArray:
        """How likely each scale is (s,) but for a target's own bearings: who tells of it is not to be told again."""
        return _PRIOR if motion.bearings.count >= _AS_MANY * self._bearings else self.probability

    def weigh(self, motions: Sequence[Motion]) -> None:
        """By all targets that were judged, those seen often."""
        self._bearings *= _FORGOTTEN
        counts = [one.bearings.count if one.is_judged else 0 for one in motions]
        most = max(counts, default=0)
        if most < max(_LEAST_BEARINGS, _AS_MANY * self._bearings):
            return
        told = [one.by_scale for one, count in zip(motions, counts, strict=True) if count >= _AS_MANY * most]
        self._bearings = float(most)
        log: FloatArray = np.log(_PRIOR) + np.mean(told, axis=0)
        likely = np.exp(log - log.max())
        self.probability = likely / likely.sum()
