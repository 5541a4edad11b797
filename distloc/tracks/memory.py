"""The last frames of a track, to see them anew; and what the attitude's error keeps from one to the next."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.sights.sights import Ray
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.types import AttitudeError, CameraPose, after

_MOST_FOUND = 3  # times that the scenery took over since the last frame in memory


@dataclass(frozen=True, slots=True)
class Frame:
    """What a track saw, or did not see, in one step, and about how far it was then.

    `attitudes` are what the attitude's error kept, and what was new of it, since the frame before in memory.
    """

    pose: CameraPose
    ray: Ray | None
    range_m: float
    attitudes: tuple[AttitudeError, ...]


class Memory:
    """Holds as many frames as a confirmation looks at.

    Of those with a sighting it also has, in any order, the cameras' places (m, 3) and turns (m, 3, 3), and the pixels
    (m, 2) at which the target was seen; NaN where there is none.
    """

    def __init__(self) -> None:
        self.frames: deque[Frame] = deque(maxlen=CONFIRM_WINDOW)
        self.cameras_enu_m = np.zeros((CONFIRM_WINDOW, 3))
        self.R_cam_from_enu = np.zeros((CONFIRM_WINDOW, 3, 3))
        self.seen_px = np.full((CONFIRM_WINDOW, 2), np.nan)
        self._next = 0
        self._since: list[AttitudeError] = []

    def step(self, pose: CameraPose) -> None:
        """A step's pose, whether it is to be remembered or not."""
        attitude = pose.attitude
        if attitude is None:
            self._since.clear()
        elif self._since and self._since[-1].found_rad is None:
            self._since[-1] = after(self._since[-1], attitude)
        else:
            self._since = [*self._since[-_MOST_FOUND:], attitude]

    def add(self, pose: CameraPose, ray: Ray | None, range_m: float) -> None:
        """This step is to be remembered."""
        self.frames.append(Frame(pose, ray, range_m, tuple(self._since)))
        self._since.clear()
        at, self._next = self._next, (self._next + 1) % CONFIRM_WINDOW
        self.cameras_enu_m[at], self.R_cam_from_enu[at] = pose.position_enu_m, pose.R_cam_from_enu
        self.seen_px[at] = np.nan if ray is None else ray.detection.centre_px

    @property
    def in_time(self) -> NDArray[np.intp]:
        """Where in these arrays the frames are, the oldest first (m,)."""
        return (np.arange(CONFIRM_WINDOW) + self._next) % CONFIRM_WINDOW

    def clear(self) -> None:
        """Forget the frames."""
        self.frames.clear()
        self.seen_px[:] = np.nan

    def from_first_sighting(self) -> list[Frame]:
        """The frames, the first in which it was seen first."""
        frames = list(self.frames)
        while frames[0].ray is None:
            frames.pop(0)
        return frames

    def sightings_of_last(self, window: int) -> int:
        """How many of the last frames showed it."""
        return [frame.ray is not None for frame in self.frames][-window:].count(True)
