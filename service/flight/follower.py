"""Follows corners of the scenery in each frame that has a pose, on a thread of its own, beside the segmenter.

The frame loop puts each frame and says which one the segmenter takes. The localise stage asks for the corners of that
one once its mask is made, as it asks the scenery itself in a replay. Nobody waits for more than the frame that is being
looked at.
"""

import asyncio
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

from distloc.scenery.compass import Compass
from distloc.scenery.corners import Corners
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.localise.scenery import FollowedScenery, Mask, NoScenery, Scenery, SceneryState

_MOST_WAITING = 4  # frames come in bursts where positions do: each holds a picture


@dataclass(eq=False, slots=True)
class PosedFrame:
    """A frame with its pose; once it `is_followed` its corners are kept with it, or None where it has none."""

    frame: Frame
    pose: CameraPose
    number: int = 0  # the follower's own
    is_followed: bool = False
    corners: Corners | None = None


class Following(Scenery, Protocol):
    """What the frame loop calls, on the event loop; the rest is the stage's."""

    @property
    def skipped(self) -> int:
        """Frames that were not followed: newer ones came before there was time."""
        ...

    def put(self, posed: PosedFrame) -> None:
        """The newest frame."""
        ...

    def take(self, posed: PosedFrame) -> None:
        """The segmenter takes this one: its corners will be asked for."""
        ...

    async def run(self) -> None:
        """Follow what is put, for ever."""
        ...

    def close(self) -> None:
        """Wait for the frame that is being followed."""
        ...


class NoFollower(NoScenery):
    """For `scenery.enabled = false`."""

    skipped = 0

    def put(self, posed: PosedFrame) -> None:
        """Nothing to follow."""

    def take(self, posed: PosedFrame) -> None:
        """Nothing to ask for."""

    async def run(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing to wait for."""


class Follower:
    """The scenery is touched on the follower's thread alone, but for `note`, which is the stage's."""

    def __init__(self, scenery: FollowedScenery) -> None:
        self._scenery = scenery
        self._waiting: deque[PosedFrame] = deque()
        self._filled = asyncio.Event()
        self._newest = self._last = 0  # numbers of frames: put, and followed
        self._taken: PosedFrame | None = None
        self._dropped = self._late = 0
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="follow")

    @property
    def state(self) -> SceneryState:
        """The scenery's, after the last frame."""
        return self._scenery.state

    @property
    def skipped(self) -> int:
        """Frames that were not followed: newer ones came before there was time."""
        return self._dropped + self._late

    def put(self, posed: PosedFrame) -> None:
        """The newest frame; where too many wait the oldest goes, but not the one that the segmenter took."""
        if len(self._waiting) == _MOST_WAITING:
            del self._waiting[1 if self._waiting[0] is self._taken else 0]
            self._dropped += 1
        self._newest += 1
        posed.number = self._newest
        self._waiting.append(posed)
        self._filled.set()

    def take(self, posed: PosedFrame) -> None:
        """The segmenter takes this one: its corners will be asked for."""
        self._taken = posed

    async def run(self) -> None:
        """Follow what is put, for ever."""
        loop = asyncio.get_running_loop()
        while True:
            while not self._waiting:
                self._filled.clear()
                await self._filled.wait()
            began_s = loop.time()
            posed = self._waiting.popleft()
            await loop.run_in_executor(self._worker, self._follow, posed)
            await loop.run_in_executor(self._worker, self._scenery.look, posed.frame)  # after whom the stage asks for
            await asyncio.sleep(loop.time() - began_s)  # half of a core at the most is the segmenter's loss

    def track(self, frame: Frame, pose: CameraPose, mask: Mask | RejectReason) -> Corners | None:
        """The corners of the frame that the segmenter took, outside of its smoke; called on the stage's thread."""
        return self._worker.submit(self._track, frame, pose, mask).result()

    def note(self, compass: Compass) -> None:
        """The localizer has stepped."""
        self._scenery.note(compass)

    def close(self) -> None:
        """Wait for the frame that is being followed; the stage asks for none any more."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _follow(self, posed: PosedFrame) -> None:
        if posed.number <= self._last:
            self._late += not posed.is_followed
            return
        self._last = posed.number
        posed.corners = self._scenery.follow(posed.frame, posed.pose)
        posed.is_followed = True

    def _track(self, frame: Frame, pose: CameraPose, mask: Mask | RejectReason) -> Corners | None:
        """Where the mask was made before the frame's turn came, that is now: what waits before it is skipped."""
        posed, self._taken = self._taken, None
        if posed is None or posed.frame is not frame:
            return self._scenery.track(frame, pose, mask)
        if not posed.is_followed:
            self._last, posed.is_followed = posed.number, True
            posed.corners = self._scenery.follow(frame, pose)
        return self._scenery.outside(frame, posed.corners, mask)


def make_follower(scenery: Scenery) -> Following:
    """A thread only where there is something to follow."""
    return Follower(scenery) if isinstance(scenery, FollowedScenery) else NoFollower()
