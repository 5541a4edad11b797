"""Takes frames through the pipeline while flying: the newest waits for its pose, a worker thread localises it."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from distloc.types import CameraPose, RejectReason
from service.autopilot.poses import WAIT_NS
from service.common.latest import Latest
from service.common.messages import Frame, LocatedTarget
from service.flight.health import FrameAges
from service.flight.watchdog import Watchdog
from service.localise.pipeline import FramePipeline
from service.localise.stage import Localised
from service.recordings.recorder import NullRecorder, Recorder

_SLACK_S = 0.001  # a timer may fire a little early

Publish = Callable[[Localised, list[LocatedTarget]], None]


class FrameLoop:
    """`take` and `pose_came` are called on the event loop; so is `publish`, with what each frame gave."""

    def __init__(
        self,
        pipeline: FramePipeline,
        recorder: Recorder | NullRecorder,
        ages: FrameAges,
        watchdog: Watchdog,
        publish: Publish,
    ) -> None:
        self.frames: Latest[Frame] = Latest()
        self._pipeline, self._recorder, self._publish = pipeline, recorder, publish
        self._ages, self._watchdog = ages, watchdog
        self._pose_came = asyncio.Event()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="localise")

    def take(self, frame: Frame) -> None:
        """A frame came from the camera."""
        self._ages.frame_heard(frame.stamp_ns)
        self._recorder.frame(frame.stamp_ns, frame.name, frame.image)
        reason = self._pipeline.gate.admit(frame)
        if reason is not None:
            self._ages.frame_unusable(reason, time.monotonic_ns())
            return
        self._watchdog.frame_waits(time.monotonic_ns())
        self.frames.put(frame)

    def pose_came(self) -> None:
        """A message came that a waiting frame's pose may be made of."""
        self._pose_came.set()

    async def run(self) -> None:
        """Localise the newest frame, for ever."""
        loop = asyncio.get_running_loop()
        while True:
            frame = await self.frames.get()
            self._watchdog.frame_waits(time.monotonic_ns())
            pose = await self._pose_of(frame)
            if isinstance(pose, RejectReason):
                self._watchdog.frame_refused()
                self._ages.frame_refused(pose, time.monotonic_ns())
                continue
            self._ages.frame_given(time.monotonic_ns())
            localised = await loop.run_in_executor(self._worker, self._pipeline.localise, frame, pose)
            if localised.reason is RejectReason.SEGMENTATION_FAILED:
                self._watchdog.frame_failed(time.monotonic_ns())
            else:
                self._watchdog.frame_done()
            if localised.mask is not None:
                self._ages.mask_made(time.monotonic_ns())
            elif localised.reason is not None:
                self._ages.frame_refused(localised.reason, time.monotonic_ns())
            self._publish(localised, self._pipeline.located(localised))

    def close(self) -> None:
        """Wait for the frame that is being localised."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    async def _pose_of(self, frame: Frame) -> CameraPose | RejectReason:
        while True:
            self._pose_came.clear()
            now_ns = time.monotonic_ns()
            pose = self._pipeline.gate.pose(frame, now_ns)
            if pose is not None:
                return pose
            left_s = max(frame.stamp_ns + WAIT_NS - now_ns, 0) * 1e-9
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(left_s + _SLACK_S):
                    await self._pose_came.wait()
