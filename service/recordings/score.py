"""How well a replay found the targets that a recording's truth names."""

from dataclasses import dataclass

import msgspec
import numpy as np

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.metrics import horizontal_error_m
from distloc.types import CameraPose, FloatArray, TargetState
from service.common.messages import LocatedTarget
from service.recordings.recording import Truth

MATCH_SHARE = 0.25  # a target belongs to a truth if it lies within this share of the range


class TargetScore(msgspec.Struct):
    """One truth and the target that found it; nulls where none did."""

    truth: int
    target: int | None = None
    state: str | None = None
    error_m: float | None = None
    error_vertical_m: float | None = None
    range_m: float | None = None
    baseline_m: float | None = None
    inside95: bool | None = None

    def __str__(self) -> str:
        if self.target is None:
            return f"fire {self.truth}: not found"
        return (
            f"fire {self.truth}: target {self.target} {self.state}, {self.error_m:.0f} m off at {self.range_m:.0f} m "
            f"with a baseline of {self.baseline_m:.0f} m, {'inside' if self.inside95 else 'outside'} its 95 % ellipse"
        )


class Score(msgspec.Struct):
    targets: list[TargetScore]
    false_confirmed: int


@dataclass(frozen=True, slots=True)
class Word:
    """The word on a target that is scored: its last report while confirmed, or its last one if it never was."""

    target: LocatedTarget
    pose: CameraPose


class ScoreKeeper:
    """Keeps one word for each target."""

    def __init__(self) -> None:
        self._words: dict[int, Word] = {}

    def add(self, targets: list[LocatedTarget], pose: CameraPose) -> None:
        """Take the reports of one frame."""
        for target in targets:
            kept = self._words.get(target.estimate.id)
            was_confirmed = kept is not None and kept.target.estimate.state is TargetState.CONFIRMED
            if target.estimate.state is TargetState.CONFIRMED or not was_confirmed:
                self._words[target.estimate.id] = Word(target, pose)

    def score(self, truth: Truth, frame_enu: LocalFrame | None) -> Score:
        """Match targets to truths one to one, confirmed ones first, then the nearest; count the confirmed left over."""
        scores = [TargetScore(truth=index) for index in range(len(truth.targets))]
        words = list(self._words.values()) if frame_enu is not None else []
        matched: set[int] = set()
        pairs = []
        for index, target in enumerate(truth.targets if frame_enu is not None else []):
            assert frame_enu is not None
            for word in words:
                place = target.base if word.target.estimate.aim == "base" and target.base else target.centre
                truth_enu_m = frame_enu.enu_from_geodetic(place.lat, place.lon, place.alt_msl_m)
                error_m = horizontal_error_m(word.target.estimate.position_enu_m, truth_enu_m)
                range_m = float(np.linalg.norm(truth_enu_m - word.pose.position_enu_m))
                if error_m <= MATCH_SHARE * range_m:
                    is_confirmed = word.target.estimate.state is TargetState.CONFIRMED
                    pairs.append((not is_confirmed, error_m, index, word.target.estimate.id, truth_enu_m))
        for _, _, index, target_id, truth_enu_m in sorted(pairs, key=lambda pair: pair[:4]):
            if scores[index].target is None and target_id not in matched:
                matched.add(target_id)
                scores[index] = _scored(index, self._words[target_id], truth_enu_m)
        left_over = [word for word in words if word.target.estimate.id not in matched]
        return Score(scores, sum(word.target.estimate.state is TargetState.CONFIRMED for word in left_over))


def _scored(index: int, word: Word, truth_enu_m: FloatArray) -> TargetScore:
    estimate = word.target.estimate
    offset_enu_m = truth_enu_m - estimate.position_enu_m
    return TargetScore(
        truth=index,
        target=estimate.id,
        state=str(estimate.state),
        error_m=round(float(np.hypot(offset_enu_m[0], offset_enu_m[1])), 3),
        error_vertical_m=round(float(abs(offset_enu_m[2])), 3),
        range_m=round(float(np.linalg.norm(truth_enu_m - word.pose.position_enu_m)), 3),
        baseline_m=round(estimate.baseline_m, 3),
        inside95=ellipse_holds(estimate.ellipse95, offset_enu_m[:2]),
    )
