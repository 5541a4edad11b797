"""The paper's Table 2 for any recording with truth: each method's error against the camera's translation.

`distloc study sequence` calls it. The paper's own rows, `PAPER_TABLE2_M`, are of a recording that is not ours to have.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.camera import Camera
from distloc.metrics import horizontal_error_m
from distloc.study.curves import mean_over_runs
from distloc.study.methods import MethodSpec
from distloc.study.runner import run_all
from distloc.types import CameraPose, FloatArray, RejectReason
from service.config import Config
from service.files import write_whole
from service.recording import Recording, RecordingError
from service.replay import PosedFrames
from service.segment import make_segmenter
from service.study_files import load_plots, rounded, write_csv, write_json

PAPER_TABLE2_M = {"MVT": (179, 210), "RMVT": (184, 286), "PF": (227, 358)}  # its smoke sequence: minimum, mean
STEP_M = 10.0  # the paper's T_s
_LATE_SHARE = 0.75  # of the baseline: the mean is over the frames beyond it
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


class Row(msgspec.Struct, frozen=True):
    """One method's line of the table, in 3-D distance but for `horizontal_mean_m`; None where it gave no estimate.

    Of the mean over the runs: its minimum over the sequence, as the paper has it, and its means over the frames beyond
    3/4 of the baseline; `estimated_share` is over those frames too.
    """

    method: str
    min_m: float | None
    mean_m: float | None
    horizontal_mean_m: float | None
    runs: int
    estimated_share: float
    baseline_m: float
    mean_range_m: float


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """A method's errors (runs, T) to the truth nearest to its estimate; NaN where it gave none."""

    method: str
    error_m: FloatArray
    horizontal_error_m: FloatArray


@dataclass(frozen=True, slots=True)
class SequenceResult:
    """What `run_sequence` found; `translation_m` and `range_m` are (T,)."""

    translation_m: FloatArray
    range_m: FloatArray
    curves: tuple[ErrorCurve, ...]

    def summary(self) -> list[Row]:
        """The table's rows in the order of the methods."""
        return [self._row(curve) for curve in self.curves]

    def _row(self, curve: ErrorCurve) -> Row:
        baseline_m = float(self.translation_m.max())
        late = self.translation_m >= _LATE_SHARE * baseline_m
        mean_m, horizontal_m = mean_over_runs(curve.error_m), mean_over_runs(curve.horizontal_error_m)
        return Row(
            method=curve.method,
            min_m=_reduced(np.min, mean_m),
            mean_m=_reduced(np.mean, mean_m[late]),
            horizontal_mean_m=_reduced(np.mean, horizontal_m[late]),
            runs=curve.error_m.shape[0],
            estimated_share=round(float(np.isfinite(curve.error_m[:, late]).mean()), 4),
            baseline_m=round(baseline_m, 1),
            mean_range_m=round(float(self.range_m.mean()), 1),
        )


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
    taker.check(posed.rejects)
    frame_enu = posed.autopilot.frame_enu
    assert frame_enu is not None  # there were poses
    centres = [target.centre for target in recording.truth.targets]
    return ObservedSequence(
        camera=config.camera.camera(),
        step_m=step_m,
        poses=tuple(taker.poses),
        masks=tuple(taker.masks),
        truths_enu_m=np.stack([frame_enu.enu_from_geodetic(one.lat, one.lon, one.alt_msl_m) for one in centres]),
        refused=dict(sorted((posed.rejects + taker.rejects).items())),
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


def run_sequence(
    observed: ObservedSequence,
    methods: Sequence[MethodSpec],
    runs: int,
    seed: int,
    jobs: int = 1,
    on_done: Callable[[int], None] = lambda done: None,
) -> SequenceResult:
    """Every method on the same frames, `runs` times each; the same seed gives the same result for any `jobs`."""
    if runs < 1 or not methods:
        raise ValueError(f"runs must be >= 1 and there must be a method, got {runs} and {len(methods)} methods")
    tasks = [_Task(observed, method, seed, run) for method in methods for run in range(runs)]
    errors_m = np.stack(run_all(_errors_m, tasks, jobs, on_done)).reshape(len(methods), runs, 2, -1)
    curves = (ErrorCurve(spec.name, own[:, 0], own[:, 1]) for spec, own in zip(methods, errors_m, strict=True))
    return SequenceResult(observed.translation_m, observed.range_m, tuple(curves))


@dataclass(frozen=True, slots=True)
class _Task:
    observed: ObservedSequence
    spec: MethodSpec
    seed: int
    run: int


def _errors_m(task: _Task) -> FloatArray:
    """Distance and distance on the map (2, T) of one method's estimates from the truth nearest to each."""
    observed = task.observed
    rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence([task.seed, task.run])))
    method = task.spec.make(observed.camera, rng)
    errors_m = np.full((2, len(observed.poses)), np.nan)
    for index, (pose, mask) in enumerate(zip(observed.poses, observed.masks, strict=True)):
        position_enu_m = method.step(pose, mask.mask())
        if isinstance(position_enu_m, np.ndarray) and np.isfinite(position_enu_m).all():
            distances_m = np.linalg.norm(observed.truths_enu_m - position_enu_m, axis=1)
            nearest = int(np.argmin(distances_m))
            errors_m[:, index] = (
                distances_m[nearest],
                horizontal_error_m(position_enu_m, observed.truths_enu_m[nearest]),
            )
    return errors_m


def write_sequence(result: SequenceResult, out: Path, title: str = "") -> None:
    """Write sequence.json, sequence.csv, curves.csv and error.png into a folder.

    Raises MissingExtraError, before anything is written, where matplotlib is missing.
    """
    plots = load_plots()
    errors_m = {curve.method: mean_over_runs(curve.error_m) for curve in result.curves}
    rows = result.summary()
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "sequence.json", rows)
    write_csv(out / "sequence.csv", [msgspec.structs.asdict(row) for row in rows])
    write_csv(out / "curves.csv", [point for curve in result.curves for point in _points(result.translation_m, curve)])
    figure = plots.error_figure(result.translation_m, errors_m, title)
    write_whole(out / "error.png", plots.png_from_figure(figure))


def _points(translation_m: FloatArray, curve: ErrorCurve) -> list[dict[str, str | float | None]]:
    columns = {
        "translation_m": translation_m,
        "error_m": mean_over_runs(curve.error_m),
        "horizontal_error_m": mean_over_runs(curve.horizontal_error_m),
    }
    return [
        {"method": curve.method} | {name: rounded(values_m[frame], 2) for name, values_m in columns.items()}
        for frame in range(translation_m.size)
    ]


def _reduced(reduce: Callable[[FloatArray], np.float64], values_m: FloatArray) -> float | None:
    held_m = values_m[np.isfinite(values_m)]
    return rounded(reduce(held_m), 2) if held_m.size else None


def _listed(counts: Counter[RejectReason]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items()))
