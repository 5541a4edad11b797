"""What a frame goes through: without a socket, on the test's own clock, and in a replay as it was in flight."""

import shutil
from collections import Counter
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.common.degraded import Degraded
from service.common.messages import Frame
from service.config.load import load_config
from service.config.sections import Config
from service.localise.pipeline import FrameGate, FramePipeline
from service.localise.stage import Localised
from service.mavlink.framer import Framer
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording
from service.recordings.tlog import read_tlog
from service.segmenters.segment import RecordedSegmenter
from tests.support.places import CUT

Image = NDArray[np.uint8]
SKY = np.full((270, 480, 3), 200, np.uint8)
SKY[:90] = (60, 120, 40)


def settings() -> Config:
    config = load_config(CUT / "config.toml")
    return msgspec.structs.replace(config, localizer=msgspec.structs.replace(config.localizer, n_particles=2000))


def picture(name: str, rng: np.random.Generator) -> Image:
    """Every tenth is black, of another shape, or the one before once more."""
    number = int(name)
    if number % 10 == 3:
        return np.zeros_like(SKY)
    if number % 10 == 5:
        return SKY[:, :300].copy()
    if number % 10 == 7:
        rng = np.random.default_rng(number - 1)
    return cv2.add(SKY, rng.integers(0, 8, SKY.shape, dtype=np.uint8)).astype(np.uint8)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded flight with pictures."""
    copy = Path(shutil.copytree(CUT, tmp_path_factory.mktemp("pictures") / "copy"))
    (copy / "frames").mkdir()
    for _, name in Recording(copy).frames():
        cv2.imwrite(str(copy / "frames" / f"{name}.png"), picture(name, np.random.default_rng(int(name))))
    return copy


class Flown:
    """The same flight as it is lived through: each frame as it comes, its pose once it is there."""

    def __init__(self, recording: Path) -> None:
        config = settings()
        autopilot = Autopilot(config.mavlink, config.camera.mount, replay=True, camera=config.camera)
        self.gate = FrameGate(config, autopilot)
        self.pipeline = FramePipeline(
            config, RecordedSegmenter(recording / "masks", config.camera.camera()), self.gate, seed=0
        )
        self.used: list[str] = []
        self.seen: set[Degraded] = set()
        self.targets = 0
        held = Recording(recording)
        frames, waiting, framer, stamp_us = held.frames(), list[Frame](), Framer(), 0
        for stamp_us, raw in read_tlog(held.tlog_path):
            while frames and frames[0][0] <= stamp_us:
                at_us, name = frames.pop(0)
                frame = Frame(at_us * 1000, name, held.load_image(name))
                if self.gate.admit(frame) is None:
                    waiting.append(frame)
                self.seen.update(self.gate.degraded())
            for mav_frame in framer.feed(raw):
                autopilot.receive(mav_frame, stamp_us * 1000)
            waiting = self._use(waiting, stamp_us * 1000)
        self._use(waiting, stamp_us * 1000 + 2_000_000_000)

    def _use(self, waiting: list[Frame], now_ns: int) -> list[Frame]:
        left = []
        for frame in waiting:
            pose = self.gate.pose(frame, now_ns)
            if pose is None:
                left.append(frame)
            elif isinstance(pose, CameraPose):
                localised = self.pipeline.localise(frame, pose)
                self.targets += len(self.pipeline.located(localised))
                self.used.append(frame.name)
        return left


def test_a_frame_refused_in_flight_is_refused_in_a_replay(recording: Path) -> None:
    flown = Flown(recording)
    posed = PosedFrames(Recording(recording), settings())
    replayed = [frame.name for frame, _ in posed.pairs(lambda stamp_ns: None)]
    assert flown.used == replayed and len(replayed) > 90
    assert flown.gate.rejects == posed.gate.rejects
    for reason in (RejectReason.BLIND_FRAME, RejectReason.BAD_FRAME, RejectReason.FROZEN_FRAME):
        assert 10 <= flown.gate.rejects[reason] <= 15
    assert flown.targets > 5


def test_a_frame_that_fails_costs_itself_alone() -> None:
    config = settings()
    gate = FrameGate(config, Autopilot(config.mavlink, config.camera.mount))

    class Failing:
        name = "failing"

        def segment(self, frame: Frame, pose: CameraPose | None) -> RejectReason:
            if frame.name == "raises":
                raise RuntimeError("as models do")
            return RejectReason.SEGMENTATION_FLOODED

    pipeline = FramePipeline(config, Failing(), gate)
    pose = CameraPose(0.0, np.zeros(3), np.eye(3))
    given: list[Localised] = [pipeline.localise(Frame(1, name, None), pose) for name in ("raises", "floods", "raises")]
    assert [one.reason for one in given] == ["segmentation_failed", "segmentation_flooded", "segmentation_failed"]
    assert pipeline.rejects == Counter({RejectReason.SEGMENTATION_FAILED: 2, RejectReason.SEGMENTATION_FLOODED: 1})
    assert all(one.mask is None and one.estimates == () for one in given)


@pytest.mark.parametrize(
    ("image", "name"), [(np.zeros_like(SKY), Degraded.CAMERA_BLIND), (SKY, Degraded.CAMERA_FROZEN)]
)
def test_pictures_that_stay_black_or_the_same_are_named(image: Image, name: Degraded) -> None:
    config = settings()
    gate = FrameGate(config, Autopilot(config.mavlink, config.camera.mount))
    for number in range(7):
        gate.admit(Frame(number * 200_000_000, str(number), image.copy()))
    assert list(gate.degraded()) == [name]
    gate.admit(Frame(1_400_000_000, "7", cv2.add(SKY, 1).astype(np.uint8)))
    assert list(gate.degraded()) == []
