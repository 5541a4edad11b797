"""The life of a track: sightings in and out, a state out. It knows nothing of positions' estimation."""

import math
from collections import deque

import numpy as np

from distloc.snapshot import LifeSnapshot
from distloc.types import FloatArray, TargetState

CONFIRM_SIGHTINGS = 8  # M of N: at least so many matched sightings
_FORGIVEN_SIGHTINGS = 60  # in a row without a doubt, for one doubt
_MOST_SIGHTINGS = 128  # for what was doubted again and again
_STAY_SIGHTINGS = 4  # of them since it came back into view
CONFIRM_WINDOW = 12  # among the last so many frames in which the target could have been seen
NEAR_M, BURST_S = 300.0, 25.0  # what may be so near, and was seen for no longer, is no target: insects, birds
LOCATED_SHARE = 0.5  # confirmed only once the 95 % semi-major axis is under this share of the range


class TrackLife:
    """M-of-N confirmation, coasting and the baseline from which a target was seen."""

    def __init__(self, id_: int, stamp_s: float, camera_position_enu_m: FloatArray) -> None:
        self.id = id_
        self.state = TargetState.TENTATIVE
        self.observations = 0
        self.misses = 0
        self.first_seen_s = self.last_seen_s = stamp_s
        self.baseline_m = 0.0
        self._first_position_enu_m = camera_position_enu_m.copy()
        self._sure_after = CONFIRM_SIGHTINGS  # sightings since the last doubt
        self._since_doubt = 0
        self._of_this_stay = CONFIRM_SIGHTINGS  # sightings
        self._recent = deque([False] * CONFIRM_WINDOW, maxlen=CONFIRM_WINDOW)  # the oldest first

    def snapshot(self) -> LifeSnapshot:
        """What it needs to go on."""
        return LifeSnapshot(
            id=self.id,
            state=self.state,
            observations=self.observations,
            misses=self.misses,
            first_seen_s=self.first_seen_s,
            last_seen_s=self.last_seen_s,
            baseline_m=self.baseline_m,
            first_position_enu_m=self._first_position_enu_m.copy(),
            sure_after=self._sure_after,
            since_doubt=self._since_doubt,
            recent=np.array(self._recent),
        )

    @classmethod
    def restored(cls, saved: LifeSnapshot) -> "TrackLife":
        """It goes on; the first step says whether what was confirmed still is, or coasts."""
        life = cls(saved.id, saved.first_seen_s, saved.first_position_enu_m)
        life.state, life.observations, life.misses = saved.state, saved.observations, saved.misses
        life.last_seen_s, life.baseline_m = saved.last_seen_s, saved.baseline_m
        life._sure_after, life._since_doubt = saved.sure_after, saved.since_doubt
        life._recent.extend(saved.recent.tolist())
        return life

    def sighting(self, is_match: bool, stamp_s: float, camera_position_enu_m: FloatArray) -> None:
        """Count a frame in which the target could have been seen."""
        self._recent.append(is_match)
        if is_match:
            self.observations += 1
            self._of_this_stay += 1
            self._since_doubt += 1
            if self._since_doubt % _FORGIVEN_SIGHTINGS == 0:
                self._sure_after = max(self._sure_after // 2, CONFIRM_SIGHTINGS)
            self.misses = 0
            self.last_seen_s = stamp_s
            travelled_m = math.dist(camera_position_enu_m, self._first_position_enu_m)
            self.baseline_m = max(self.baseline_m, travelled_m)
        else:
            self.misses += 1

    def settle(self, is_seen: bool, major_share_of_range: float) -> None:
        """Move on to the state that the sightings and the estimate's spread allow."""
        if self.state is TargetState.TENTATIVE:
            if self.is_seen_enough and not self.is_doubted and major_share_of_range <= LOCATED_SHARE:
                self.state = TargetState.CONFIRMED
        else:
            self.state = TargetState.CONFIRMED if is_seen else TargetState.COASTING

    def come_back(self) -> None:
        """After a while out of view: what is seen now may be something else, so sightings from before don't confirm."""
        self._of_this_stay = 0

    def doubt(self) -> None:
        """Take a confirmation back: where it is must be found again, in twice as many sightings each time.

        What moves contradicts one place after another; what stands does so only where
        the autopilot's estimate jumps.
        """
        if self.state is not TargetState.TENTATIVE:
            self._sure_after = min(2 * self._sure_after, _MOST_SIGHTINGS)
        self.state = TargetState.TENTATIVE
        self._since_doubt = 0

    def withdraw(self) -> None:
        """Take a confirmation back for as long as the target looks like no smoke."""
        self.state = TargetState.TENTATIVE

    @property
    def sightings(self) -> int:
        """Of the last `CONFIRM_WINDOW` frames in which it could have been seen."""
        return self._recent.count(True)

    @property
    def is_seen_enough(self) -> bool:
        """Whether these are enough to confirm it."""
        return self.sightings >= CONFIRM_SIGHTINGS and self._of_this_stay >= _STAY_SIGHTINGS

    @property
    def is_doubted(self) -> bool:
        """Whether it must be seen more often since the last doubt."""
        return self._since_doubt < self._sure_after

    @property
    def is_burst(self) -> bool:
        """Whether all its sightings are of one short while."""
        return self.last_seen_s - self.first_seen_s < BURST_S

    @property
    def existence(self) -> float:
        """Laplace's rule of succession on the window's sightings: (hits + 1) / (frames + 2)."""
        seen = min(self.observations + self.misses, CONFIRM_WINDOW)
        return (self.sightings + 1) / (seen + 2) if seen else 0.5
