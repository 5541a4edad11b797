"""The last frames of a track, to see them anew; and what the attitude's error keeps from one to the next."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from distloc.sights.sights import Ray
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.types import AttitudeError, CameraPose, FloatArray, after

_MOST_FOUND = 3  # times that the scenery took over since the last frame in memory


@dataclass(frozen=True, slots=True)
class Frame:
    """What a track saw, or did not see, in one step, and about how far it was then.

    `attitudes` are what the attitude's error kept, and what was new of it, since that platform's frame before.
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
        self.seen_px, self._sizes_px = np.full((CONFIRM_WINDOW, 2), np.nan), np.full((CONFIRM_WINDOW, 2), np.nan)
        self._platforms = [""] * CONFIRM_WINDOW
        self.oldest = self._last = 0  # where in these arrays that is; the younger ones follow, round their end
        self._since: dict[str, list[AttitudeError]] = {}

    def step(self, pose: CameraPose) -> None:
        """A step's pose, whether it is to be remembered or not."""
        attitude, since = pose.attitude, self._since.get(pose.platform, [])
        if attitude is None:
            since = []
        elif since and since[-1].found_rad is None:
            since[-1] = after(since[-1], attitude)
        else:
            since = [*since[-_MOST_FOUND:], attitude]
        self._since[pose.platform] = since

    def since(self, platform: str) -> tuple[AttitudeError, ...]:
        """What a platform's attitude error kept, and what was new of it, since its last frame that is remembered."""
        return tuple(self._since.get(platform, ()))

    def add(self, pose: CameraPose, ray: Ray | None, range_m: float) -> None:
        """This step is to be remembered."""
        self.frames.append(Frame(pose, ray, range_m, tuple(self._since.pop(pose.platform, ()))))
        at, self.oldest = self.oldest, (self.oldest + 1) % CONFIRM_WINDOW
        self._last, self._platforms[at] = at, pose.platform
        self.cameras_enu_m[at], self.R_cam_from_enu[at] = pose.position_enu_m, pose.R_cam_from_enu
        # a point is of no picture, so nothing on a lens
        self.seen_px[at] = np.nan if ray is None or ray.detection.is_point else ray.detection.centre_px
        self._sizes_px[at] = np.nan if ray is None else ray.size_px

    def seen_by_last_px(self) -> FloatArray:
        """The pixels (m, 2) of the frames of the platform that looked last; NaN in the others'."""
        last = self._platforms[self._last]
        if self._platforms.count(last) == CONFIRM_WINDOW:
            return self.seen_px
        return np.where([[one != last] for one in self._platforms], np.nan, self.seen_px)

    def segments_by(self, platform: str) -> tuple[FloatArray, FloatArray]:
        """The middles and the sizes (m, 2), in pixels, of the segments that a platform's camera showed of it."""
        is_its = [one == platform for one in self._platforms] & np.isfinite(self.seen_px).all(axis=1)
        return self.seen_px[is_its], self._sizes_px[is_its]

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
