"""What a recorded flight gives every method: its frames' poses and masks, and the truth, in one set of axes."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, FloatArray, RejectReason
from service.config.sections import Config
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording, RecordingError
from service.segmenters.segment import make_segmenter

STEP_M = 10.0  # the paper's T_s
_MAX_FRAMES = 5_000  # 50 km of flight at 10 m; a mask takes a few kB, and the triangulations' time grows as the square


@dataclass(frozen=True, slots=True)
class CompactMask:
    """A mask as the PNG of its bounding box, empty where nothing is positive; `corner_px` is the box's (x, y)."""

    png: bytes
    corner_px: tuple[int, int]
    shape: tuple[int, int]

    @classmethod
    def from_mask(cls, mask: NDArray[np.uint8]) -> "CompactMask":
        x, y, width, height = cv2.boundingRect(mask)
        png = cv2.imencode(".png", mask[y : y + height, x : x + width])[1].tobytes() if width else b""
        return cls(png, (x, y), (mask.shape[0], mask.shape[1]))

    def mask(self) -> NDArray[np.uint8]:
        """The whole mask (h, w)."""
        mask = np.zeros(self.shape, dtype=np.uint8)
        if self.png:
            crop = np.asarray(cv2.imdecode(np.frombuffer(self.png, dtype=np.uint8), cv2.IMREAD_GRAYSCALE))
            x, y = self.corner_px
            mask[y : y + crop.shape[0], x : x + crop.shape[1]] = crop
        return mask


@dataclass(frozen=True, slots=True)
class ObservedSequence:
    """The frames that every method gets, in order, and the truth (n, 3) in the same axes.

    `refused` counts frames by reason; `before` those that showed nothing before the first used one, `between` those
    less than `step_m` of camera travel after the last used one.
    """

    camera: Camera
    step_m: float
    poses: tuple[CameraPose, ...]
    masks: tuple[CompactMask, ...]
    truths_enu_m: FloatArray
    refused: dict[RejectReason, int]
    before: int
    between: int

    @property
    def translation_m(self) -> FloatArray:
        """Distance (T,) of the camera from the first used frame."""
        positions_enu_m = np.stack([pose.position_enu_m for pose in self.poses])
        return np.asarray(np.linalg.norm(positions_enu_m - positions_enu_m[0], axis=1))

    @property
    def range_m(self) -> FloatArray:
        """Distance (T,) of the camera from the truth nearest to it."""
        positions_enu_m = np.stack([pose.position_enu_m for pose in self.poses])
        return np.asarray(np.linalg.norm(positions_enu_m[:, None] - self.truths_enu_m, axis=2).min(axis=1))


def observe_sequence(
    recording: Recording, config: Config, on_stamp: Callable[[int], None], step_m: float = STEP_M
) -> ObservedSequence:
    """Run a recording once through telemetry, poses and segmenter and keep the frames that the methods get.

    They begin with the first frame that shows something, as no method does anything before it, and follow each other
    after at least `step_m` of camera travel. `on_stamp` gets the log's time in ns. Raises RecordingError where truth,
    poses or positive pixels are missing, or the camera did not move.
    """
    if not step_m > 0:
        raise ValueError(f"step_m must be above 0, got {step_m}")
    if recording.truth is None or not recording.truth.targets:
        raise RecordingError(f"{recording.tlog_path.parent}: truth.json with at least one target is missing")
    if not recording.frames():
        raise RecordingError(f"{recording.tlog_path.parent}: frames.csv with at least one frame is missing")
    posed = PosedFrames(recording, config)
    taker = _FrameTaker(recording, config, step_m)
    for frame, pose in posed.pairs(on_stamp):
        mask = taker.segmenter.segment(frame, pose) if taker.is_due(pose) else None
        if mask is not None:
            taker.take(pose, mask)
    taker.check(posed.gate.rejects)
    frame_enu = posed.autopilot.frame_enu
    assert frame_enu is not None  # there were poses
    centres = [target.centre for target in recording.truth.targets]
    return ObservedSequence(
        camera=config.camera.camera(),
        step_m=step_m,
        poses=tuple(taker.poses),
        masks=tuple(taker.masks),
        truths_enu_m=np.stack([frame_enu.enu_from_geodetic(one.lat, one.lon, one.alt_msl_m) for one in centres]),
        refused=dict(sorted((posed.gate.rejects + taker.rejects).items())),
        before=taker.before,
        between=taker.between,
    )


class _FrameTaker:
    """Chooses the frames that are used, and says what is wrong where there are none."""

    def __init__(self, recording: Recording, config: Config, step_m: float) -> None:
        self.segmenter = make_segmenter(config.segmenter, config.camera.camera(), recording.tlog_path.parent)
        self.poses: list[CameraPose] = []
        self.masks: list[CompactMask] = []
        self.rejects: Counter[RejectReason] = Counter()
        self.before = self.between = 0
        self._recording, self._kind, self._step_m = recording, config.segmenter.kind, step_m

    def is_due(self, pose: CameraPose) -> bool:
        """Whether the camera has come far enough; segmenters keep nothing from frame to frame, so one may be left."""
        if not self.poses:
            return True
        is_due = float(np.linalg.norm(pose.position_enu_m - self.poses[-1].position_enu_m)) >= self._step_m
        self.between += not is_due
        return is_due

    def take(self, pose: CameraPose, mask: NDArray[np.uint8] | RejectReason) -> None:
        if isinstance(mask, RejectReason):
            self.rejects[mask] += 1
            return
        if not self.poses and cv2.countNonZero(mask) == 0:
            self.before += 1
            return
        if len(self.poses) == _MAX_FRAMES:
            raise RecordingError(
                f"{self._recording.tlog_path.parent}: more than {_MAX_FRAMES} frames {self._step_m:g} m apart: "
                "take a longer step, or cut the recording"
            )
        self.poses.append(pose)
        self.masks.append(CompactMask.from_mask(mask))

    def check(self, without_pose: Counter[RejectReason]) -> None:
        """Raise RecordingError unless there are at least two frames to compare the methods on."""
        folder, count = self._recording.tlog_path.parent, len(self._recording.frames())
        if not self.poses:
            if not self.rejects and not self.before:
                raise RecordingError(f"{folder}: none of {count} frames has a pose ({_listed(without_pose)})")
            what = ", ".join(filter(None, [f"{self.before} masks empty", _listed(self.rejects)]))
            raise RecordingError(
                f"{folder}: no frame with a pose has a positive pixel (segmenter {self._kind!r}: {what})"
            )
        if len(self.poses) < 2:
            raise RecordingError(
                f"{folder}: the camera moved less than {self._step_m:g} m after it first saw something: "
                "take a recording with more translation, or a shorter step"
            )


def _listed(counts: Counter[RejectReason]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items()))
