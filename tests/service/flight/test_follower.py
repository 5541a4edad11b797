"""Corners in every frame while the segmenter works: the frame loop, its threads and the scenery are the real ones."""

import asyncio
import functools
import math
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from distloc.scenery.corners import Corners
from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.common.messages import Frame
from service.config.sections import CameraConfig, Config, LocaliserSection, MavlinkConfig, MountConfig
from service.flight import frame_loop
from service.flight.follower import Follower, NoFollower, PosedFrame, make_follower
from service.flight.frame_loop import FrameLoop
from service.flight.health import FrameAges
from service.flight.watchdog import Watchdog
from service.localise.pipeline import FrameGate, FramePipeline
from service.localise.scenery import FollowedScenery, Lacking, Mask, NoScenery, SceneryState
from service.recordings.recorder import NullRecorder
from tests.support.ground_pictures import GroundPictures, flown
from tests.support.places import HANG_S
from tests.support.running_app import run, until

CAMERA = CameraConfig(width=480, height=270, fx=400.0, fy=400.0, cx=239.5, cy=134.5)
CONFIG = Config(camera=CAMERA, localizer=LocaliserSection(n_particles=200))
PICTURES = GroundPictures(CAMERA.camera())
NO_SMOKE: Mask = np.zeros((270, 480), np.uint8)
PERIOD_S = 0.25
A_MASK = 9  # frames: over the 2 s that corners are found again over
OFF_DEG = 3.2


@functools.cache
def frame_at(number: int) -> Frame:
    return Frame(round(number * PERIOD_S * 1e9), str(number), PICTURES.at(flown(number * PERIOD_S)))


def posed(number: int) -> PosedFrame:
    return PosedFrame(frame_at(number), flown(number * PERIOD_S))


class HeldSegmenter:
    """Sees no smoke, as often as the test lets it."""

    name = "held"

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.may = threading.Semaphore(0)

    def segment(self, frame: Frame, pose: CameraPose | None) -> Mask | RejectReason:
        self.begun.append(frame.name)
        assert self.may.acquire(timeout=HANG_S)
        return NO_SMOKE


class WatchedScenery(FollowedScenery):
    """Keeps the names of the frames that were followed; waits in those that are `held`, with `waits` set."""

    def __init__(self) -> None:
        super().__init__(CAMERA.camera(), 48)
        self.seen: list[str] = []
        self.held: set[str] = set()
        self.waits, self.go = threading.Event(), threading.Event()

    def _followed(self, frame: Frame, pose: CameraPose, smoke: Mask | None) -> Corners | None:
        if frame.name in self.held:
            self.waits.set()
            assert self.go.wait(HANG_S)
        corners = super()._followed(frame, pose, smoke)
        self.seen.append(frame.name)
        return corners


class Flight:
    """A frame loop whose poses are of a compass that is off; `refused` says why a frame has none, or None: not yet."""

    def __init__(self, scenery: WatchedScenery | None = None) -> None:
        self.refused: dict[str, RejectReason | None] = {}
        self.scenery = scenery or WatchedScenery()
        self.segmenter, self.follower = HeldSegmenter(), Follower(self.scenery)
        self.given: list[set[int]] = []  # names of the corners that the compass got
        self.localised: list[str] = []
        autopilot = Autopilot(MavlinkConfig(), MountConfig())
        autopilot.camera_pose = self._pose  # type: ignore[method-assign]
        self.gate = FrameGate(CONFIG, autopilot)
        self.pipeline = FramePipeline(CONFIG, self.segmenter, self.gate, scenery=self.follower)
        self.loop = FrameLoop(self.pipeline, self.follower, NullRecorder(), FrameAges(), Watchdog([]), self._publish)
        step = self.pipeline.stage.localizer.step

        def noted(pose: CameraPose, mask: Mask, corners: Corners | None) -> Any:
            self.given.append(set() if corners is None else set(corners.names.tolist()))
            return step(pose, mask, corners)

        self.pipeline.stage.localizer.step = noted  # type: ignore[method-assign, assignment]

    def _pose(self, stamp_ns: int, now_ns: int) -> CameraPose | RejectReason | None:
        stamp_s = stamp_ns * 1e-9
        return self.refused.get(str(round(stamp_s / PERIOD_S)), flown(stamp_s, OFF_DEG))

    def _publish(self, localised: Any, targets: list[Any]) -> None:
        self.localised.append(localised.frame.name)

    async def see(self, *numbers: int) -> None:
        """Frames from the camera, each once the one before is followed."""
        for number in numbers:
            self.loop.take(frame_at(number))
            await until(lambda name=str(number): self.scenery.seen[-1:] == [name], f"frame {number} is followed")

    async def make_mask(self) -> None:
        """Let the segmenter end its frame, and take the next."""
        masks = len(self.segmenter.begun)
        self.segmenter.may.release()
        await until(lambda: len(self.segmenter.begun) > masks, "the next frame is taken")


@asynccontextmanager
async def flying(flight: Flight) -> AsyncIterator[None]:
    task = asyncio.create_task(flight.loop.run())
    try:
        yield
    finally:
        task.cancel()
        closed = asyncio.get_running_loop().run_in_executor(None, flight.loop.close)
        flight.scenery.go.set()
        flight.segmenter.may.release(1000)
        await closed
        with pytest.raises(asyncio.CancelledError):
            await task
        assert not [one.name for one in threading.enumerate() if one.name.startswith(("follow", "localise"))]


def heading_off_deg(state: SceneryState) -> float:
    assert state.source == "scenery" and state.heading_error_rad is not None
    return math.degrees(state.heading_error_rad)


def test_corners_outlast_a_mask_that_takes_over_two_seconds_and_tell_what_a_replay_tells() -> None:
    flight, count = Flight(), 10 * A_MASK

    async def body() -> None:
        async with flying(flight):
            await flight.see(0)
            await until(lambda: flight.segmenter.begun, "the first frame is taken")
            for first in range(1, count, A_MASK):
                await flight.see(*range(first, min(first + A_MASK, count)))
                await flight.make_mask()

    run(body())
    assert flight.scenery.seen == [str(number) for number in range(count)]  # each once, in their order
    assert flight.scenery.lacking == {} and flight.follower.skipped == 0
    shared = [len(now & before) for before, now in zip(flight.given, flight.given[1:], strict=False)]
    assert len(shared) >= 8 and min(shared) >= 8
    assert flight.follower.state.reasons.get("few_corners", 0) <= 1

    replayed = FramePipeline(CONFIG, HeldSegmenter(), flight.gate)
    replayed.stage.segmenter.may.release(count)  # type: ignore[attr-defined]
    for number in range(count):
        replayed.localise(frame_at(number), flown(number * PERIOD_S, OFF_DEG))
    for state in (flight.follower.state, replayed.stage.scenery.state):
        assert heading_off_deg(state) == pytest.approx(OFF_DEG, abs=0.6)


def test_frames_that_are_refused_are_not_followed() -> None:
    flight = Flight()
    flight.refused = {"2": RejectReason.TURNING, "3": RejectReason.NO_FIX}

    async def body() -> None:
        async with flying(flight):
            await flight.see(0, 1)
            for number in (2, 3):
                flight.loop.take(frame_at(number))
            frozen = frame_at(3)
            flight.loop.take(Frame(frozen.stamp_ns + 1, "frozen", frozen.image))
            flight.loop.take(Frame(frozen.stamp_ns + 2, "black", np.zeros((270, 480, 3), np.uint8)))
            await flight.see(4)

    run(body())
    assert flight.scenery.seen == ["0", "1", "4"]
    refused = ("turning", "no_fix", "frozen_frame", "blind_frame")
    assert flight.gate.rejects == {RejectReason(name): 1 for name in refused}


def test_the_newest_of_those_that_wait_for_poses_is_kept_and_the_first_gets_through(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(frame_loop, "WAIT_NS", round(1e9 * 10 * HANG_S) + 2**62)
    flight = Flight()
    flight.refused = dict.fromkeys(map(str, range(8)))

    async def body() -> None:
        async with flying(flight):
            for number in range(8):
                flight.loop.take(frame_at(number))
            await asyncio.sleep(0)
            flight.refused.clear()
            flight.loop.pose_came()
            await until(lambda: len(flight.scenery.seen) == 4, "all are followed")

    run(body())
    assert flight.scenery.seen == ["0", "1", "2", "7"]
    assert flight.segmenter.begun[0] == "0"
    assert flight.loop.frames.dropped >= 4


def test_a_tracker_that_fails_costs_that_frames_corners_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    tracker = flight.scenery._tracker
    follow = tracker.follow

    def failing(image: Any, pose: CameraPose, smoke: Mask | None = None) -> Corners:
        if pose.stamp_s == pytest.approx(2 * PERIOD_S):
            raise RuntimeError("as OpenCV does")
        return follow(image, pose, smoke)

    monkeypatch.setattr(tracker, "follow", failing)

    async def body() -> None:
        async with flying(flight):
            flight.segmenter.may.release(2)
            await flight.see(0, 1)
            await until(lambda: flight.localised == ["0", "1"], "both are localised")
            flight.loop.take(frame_at(2))
            await until(lambda: flight.scenery.lacking[Lacking.TRACKER_FAILED] == 1, "it failed")
            await until(lambda: flight.segmenter.begun[-1] == "2", "the frame is taken")
            await flight.see(3)
            flight.segmenter.may.release(2)
            await until(lambda: flight.localised[-1] == "3", "the frames are localised")

    run(body())
    assert flight.localised == ["0", "1", "2", "3"]
    assert len(flight.given[0] & flight.given[1]) > 20
    assert flight.given[2] == set()
    assert len(flight.given[3]) > 20 and not flight.given[3] & flight.given[1]  # begun anew


def test_it_ends_while_both_threads_are_at_work() -> None:
    flight = Flight()
    flight.scenery.held = {"2"}

    async def body() -> None:
        async with flying(flight):
            await flight.see(0, 1)
            flight.loop.take(frame_at(2))
            await until(flight.scenery.waits.is_set, "a frame is being followed")

    run(body())
    assert flight.scenery.seen[:2] == ["0", "1"]


@asynccontextmanager
async def following(scenery: WatchedScenery) -> AsyncIterator[Follower]:
    follower = Follower(scenery)
    task = asyncio.create_task(follower.run())
    try:
        yield follower
    finally:
        scenery.go.set()
        task.cancel()
        follower.close()


def test_where_there_is_no_time_old_frames_are_skipped_but_not_the_segmenters() -> None:
    scenery = WatchedScenery()
    scenery.held = {"0"}

    async def body() -> None:
        async with following(scenery) as follower:
            follower.put(posed(0))
            await until(scenery.waits.is_set, "the first is being followed")
            frames = [posed(number) for number in range(1, 8)]
            follower.put(frames[0])
            follower.take(frames[0])
            for one in frames[1:]:
                follower.put(one)
            assert follower.skipped == 3
            scenery.go.set()
            await until(lambda: len(scenery.seen) == 5, "the others are followed")
            assert scenery.seen == ["0", "1", "5", "6", "7"]
            assert frames[0].corners is not None and frames[0].corners.names.size > 20

    run(body())


def test_a_mask_that_is_made_first_waits_for_the_frame_at_work_alone() -> None:
    scenery = WatchedScenery()
    scenery.held = {"0"}

    async def body() -> None:
        async with following(scenery) as follower:
            frames = [posed(number) for number in range(5)]
            follower.put(frames[0])
            await until(scenery.waits.is_set, "the first is being followed")
            for one in frames[1:4]:
                follower.put(one)
            follower.take(frames[3])
            found = follower._worker.submit(follower._track, frames[3].frame, frames[3].pose, NO_SMOKE)
            scenery.go.set()
            corners = await asyncio.wrap_future(found)
            assert corners is not None and corners.names.size > 20
            follower.put(frames[4])
            await until(lambda: scenery.seen[-1] == "4", "the newest is followed")
            assert scenery.seen == ["0", "3", "4"] and scenery.lacking == {}
            assert follower.skipped == 2

    run(body())


def test_without_scenery_there_is_no_thread() -> None:
    assert isinstance(make_follower(NoScenery()), NoFollower)
