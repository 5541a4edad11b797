"""Takes frames through the pipeline while flying: each waits for its pose, a worker thread localises the newest.

All that have a pose go to the follower as well, which looks at each for corners of the scenery.
"""

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from distloc.types import CameraPose, RejectReason
from service.autopilot.poses import WAIT_NS
from service.common import aio
from service.common.latest import Latest
from service.common.messages import Frame, LocatedTarget
from service.flight.follower import Following, PosedFrame
from service.flight.frame_rates import FrameRates
from service.flight.health import FrameAges
from service.flight.watchdog import Watchdog
from service.localise.pipeline import FramePipeline
from service.localise.stage import Localised
from service.recordings.recorder import NullRecorder, Recorder

_SLACK_S = 0.001  # a timer may fire a little early
_MOST_WAITING = 4  # for their poses: what a position at 5 Hz leaves of a camera at 20; each holds a picture

Publish = Callable[[Localised, list[LocatedTarget]], None]


class FrameLoop:
    """`take` and `pose_came` are called on the event loop; so is `publish`, with what each frame gave."""

    def __init__(
        self,
        pipeline: FramePipeline,
        follower: Following,
        recorder: Recorder | NullRecorder,
        ages: FrameAges,
        watchdog: Watchdog,
        publish: Publish,
    ) -> None:
        self.frames: Latest[PosedFrame] = Latest()
        self.rates = FrameRates()
        self._waiting: deque[Frame] = deque()
        self._frame_came = asyncio.Event()
        self._is_localising = False
        self._pipeline, self._follower, self._recorder, self._publish = pipeline, follower, recorder, publish
        self._ages, self._watchdog = ages, watchdog
        self._pose_came = asyncio.Event()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="localise")

    def take(self, frame: Frame) -> None:
        """A frame came from the camera."""
        self._ages.frame_heard(frame.stamp_ns)
        self.rates.came(time.monotonic_ns())
        self._recorder.frame(frame.stamp_ns, frame.name, frame.image)
        reason = self._pipeline.gate.admit(frame)
        if reason is not None:
            self._ages.frame_unusable(reason, time.monotonic_ns())
            return
        self._watchdog.frame_waits(time.monotonic_ns())
        if len(self._waiting) == _MOST_WAITING:  # the first goes on waiting, else none would ever get through
            self._waiting.pop()
            self.frames.dropped += 1
        self._waiting.append(frame)
        self._frame_came.set()

    def pose_came(self) -> None:
        """A message came that a waiting frame's pose may be made of."""
        self._pose_came.set()

    async def run(self) -> None:
        """Localise the newest frame and follow each, for ever."""
        async with aio.TaskGroup() as group:
            group.create_task(self._find_poses(), name="poses")
            group.create_task(self._follower.run(), name="follow")
            await self._localise()

    def close(self) -> None:
        """Wait for the frame that is being localised, then for the one that is being followed."""
        self._worker.shutdown(wait=True, cancel_futures=True)
        self._follower.close()

    async def _find_poses(self) -> None:
        """Give each frame its pose, in their order."""
        while True:
            while not self._waiting:
                self._frame_came.clear()
                await self._frame_came.wait()
            pose = await self._pose_of(self._waiting[0])
            frame = self._waiting.popleft()
            if isinstance(pose, RejectReason):
                self._refused(pose)
                continue
            posed = PosedFrame(frame, pose)
            self._follower.put(posed)
            self.frames.put(posed)
            await asyncio.sleep(0)  # an idle segmenter takes the first of those whose poses came together

    def _refused(self, reason: RejectReason) -> None:
        self._ages.frame_refused(reason, time.monotonic_ns())
        if not self._is_localising:  # else that one has to get through still
            self._watchdog.frame_refused()

    async def _localise(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            posed = await self.frames.get()
            self._is_localising = True
            self._follower.take(posed)
            self._watchdog.frame_waits(time.monotonic_ns())
            self._ages.frame_given(time.monotonic_ns())
            localised = await loop.run_in_executor(self._worker, self._pipeline.localise, posed.frame, posed.pose)
            self._is_localising = False
            if localised.reason is RejectReason.SEGMENTATION_FAILED:
                self._watchdog.frame_failed(time.monotonic_ns())
            else:
                self._watchdog.frame_done()
            if localised.mask is not None:
                self.rates.done(time.monotonic_ns())
                self._ages.mask_made(time.monotonic_ns())
            elif localised.reason is not None:
                self._ages.frame_refused(localised.reason, time.monotonic_ns())
            self._publish(localised, self._pipeline.located(localised))

    async def _pose_of(self, frame: Frame) -> CameraPose | RejectReason:
        while True:
            self._pose_came.clear()
            now_ns = time.monotonic_ns()
            pose = self._pipeline.gate.pose(frame, now_ns)
            if pose is not None:
                return pose
            left_s = max(frame.stamp_ns + WAIT_NS - now_ns, 0) * 1e-9
            with contextlib.suppress(TimeoutError):
                async with aio.timeout(left_s + _SLACK_S):
                    await self._pose_came.wait()
