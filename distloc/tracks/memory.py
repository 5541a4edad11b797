"""The last frames of a track, to see them anew; and what the attitude's error keeps from one to the next."""

from collections import deque
from dataclasses import dataclass

from distloc.sights.sights import Ray
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.types import AttitudeError, CameraPose, after


@dataclass(frozen=True, slots=True)
class Frame:
    """What a track saw, or did not see, in one step, and about how far it was then.

    `attitude` is what the attitude's error keeps, and what is new of it, since the frame before in memory.
    """

    pose: CameraPose
    ray: Ray | None
    range_m: float
    attitude: AttitudeError | None


class Memory:
    """Holds as many frames as a confirmation looks at."""

    def __init__(self) -> None:
        self.frames: deque[Frame] = deque(maxlen=CONFIRM_WINDOW)
        self._since: AttitudeError | None = None

    def step(self, pose: CameraPose) -> None:
        """A step's pose, whether it is to be remembered or not."""
        self._since = pose.attitude if self._since is None else after(self._since, pose.attitude)

    def add(self, pose: CameraPose, ray: Ray | None, range_m: float) -> None:
        """This step is to be remembered."""
        self.frames.append(Frame(pose, ray, range_m, self._since))
        self._since = None

    def from_first_sighting(self) -> list[Frame]:
        """The frames, the first in which it was seen first."""
        frames = list(self.frames)
        while frames[0].ray is None:
            frames.pop(0)
        return frames

    def rays(self) -> list[Ray]:
        """What was seen of it."""
        return [frame.ray for frame in self.frames if frame.ray is not None]

    def sightings_of_last(self, window: int) -> int:
        """How many of the last frames showed it."""
        return [frame.ray is not None for frame in self.frames][-window:].count(True)
