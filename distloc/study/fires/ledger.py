"""What was reported of a scene's fires, against where they truly were: whose each target was, and what it said.

A report is *confirmed* where its state is confirmed or coasting: a crew is told of both. A fire's place is that of its
source on the ground at the time, whatever its smoke does.

A report *points at* a fire where its direction from the true camera is within `GATE_RAD`, in azimuth and in elevation,
of the box about the smoke and the source. Of several fires it points at the one that is nearest on the map; where there
are as many other reports, each is first given a fire of its own, so that the sum of the squared distances is least: a
compass that is wrong turns all reports alike, and fires may stand closer than that. A target is
a fire's if, of its confirmed reports of steps that showed it (not coasting), more point at that fire than at any other;
it is false if most point at none. So a target that is far too near or too far is the fire's all the same, and counts as
wrong; one that slides from a fire to another stays the first one's, and counts as wrong there.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.metrics import horizontal_error_m, nees
from distloc.study.coverage.ledger import BELIEVED, LIVING, in_state
from distloc.study.fires.smoke import Smoke, directions_from
from distloc.study.fires.staging import SceneFrame
from distloc.tracks.assignment.matching import best_pairs
from distloc.types import BoolArray, FloatArray, TargetEstimate, TargetState

GATE_RAD: FloatArray = np.radians([6.0, 3.0])  # three standard deviations of the heading's error, six of the tilt's
NOBODY = -1
_ANY_M2 = 1e12  # more than any distance squared: as many reports as can be have a fire of their own


@dataclass(frozen=True, slots=True)
class FireReports:
    """The confirmed reports of targets that are a fire's (R,), in the order of time.

    Errors and half-lengths are shares of the true range from the camera to the fire at the time; `nees` is the error's
    square by the covariance on the map.
    """

    step: NDArray[np.int64]
    fire: NDArray[np.int64]
    target: NDArray[np.int64]
    is_inside: BoolArray
    nees: FloatArray
    error_share: FloatArray
    half_share: FloatArray


@dataclass(frozen=True, slots=True)
class SceneTrack:
    """One flight past K fires in T steps.

    `seen_s` (K,) is when a fire's smoke was first in the picture, `told_s` when any living report first pointed at it,
    `confirmed_s` when the first confirmed report of one of its targets came; infinite where never. `held` (K, T) is the
    id of its target, of several confirmed ones the one seen most, 0 where none is confirmed. `has_confirmed` (T,) is
    whether anything was, also what is nobody's. `ids_given` counts all targets that were reported in any state.
    """

    stamps_s: FloatArray
    seen_s: FloatArray
    told_s: FloatArray
    confirmed_s: FloatArray
    reports: FireReports
    held: NDArray[np.int64]
    has_confirmed: BoolArray
    false_ids: int
    ids_given: int


@dataclass(frozen=True, slots=True)
class _Row:
    """A confirmed report, measured against each fire (K,)."""

    step: int
    id: int
    observations: int
    points_at: int | None  # None while coasting
    is_inside: BoolArray
    nees: FloatArray
    error_share: FloatArray
    half_share: FloatArray


class SceneLedger:
    """Takes one flight's reports in the order of time."""

    def __init__(self, fires: Sequence[Smoke]) -> None:
        self._fires = fires
        self._rows: list[_Row] = []
        self._stamps_s: list[float] = []
        self._seen_s, self._told_s = (np.full(len(fires), np.inf) for _ in range(2))
        self._has_confirmed: list[bool] = []
        self._ids: set[int] = set()

    def enter(self, frame: SceneFrame, estimates: Sequence[TargetEstimate]) -> None:
        """The next frame and what was reported after it."""
        stamp_s = frame.true_pose.stamp_s
        living = in_state(estimates, LIVING)
        points_at = self._points_at(frame, living)
        self._seen_s[frame.is_in_view & np.isinf(self._seen_s)] = stamp_s
        pointed = [fire for fire in points_at if fire != NOBODY and np.isinf(self._told_s[fire])]
        self._told_s[pointed] = stamp_s
        self._ids |= {one.id for one in living}
        believed = [(one, fire) for one, fire in zip(living, points_at, strict=True) if one.state in BELIEVED]
        self._rows += [self._row(frame, one, fire) for one, fire in believed]
        self._has_confirmed.append(bool(believed))
        self._stamps_s.append(stamp_s)

    def closed(self) -> SceneTrack:
        """The whole flight."""
        owners = self._owners()
        stamps_s, count = np.array(self._stamps_s), len(self._fires)
        held, most_seen = (np.zeros((count, stamps_s.size), dtype=np.int64) for _ in range(2))
        confirmed_s = np.full(count, np.inf)
        kept = [(row, owners[row.id]) for row in self._rows if owners[row.id] != NOBODY]
        for row, fire in kept:
            confirmed_s[fire] = min(confirmed_s[fire], stamps_s[row.step])
            if row.observations > most_seen[fire, row.step]:
                most_seen[fire, row.step], held[fire, row.step] = row.observations, row.id
        reports = FireReports(
            step=np.array([row.step for row, _ in kept], dtype=np.int64),
            fire=np.array([fire for _, fire in kept], dtype=np.int64),
            target=np.array([row.id for row, _ in kept], dtype=np.int64),
            is_inside=np.array([row.is_inside[fire] for row, fire in kept], dtype=np.bool_),
            nees=np.array([row.nees[fire] for row, fire in kept], dtype=np.float64),
            error_share=np.array([row.error_share[fire] for row, fire in kept], dtype=np.float64),
            half_share=np.array([row.half_share[fire] for row, fire in kept], dtype=np.float64),
        )
        return SceneTrack(
            stamps_s=stamps_s,
            seen_s=self._seen_s,
            told_s=self._told_s,
            confirmed_s=confirmed_s,
            reports=reports,
            held=held,
            has_confirmed=np.array(self._has_confirmed, dtype=np.bool_),
            false_ids=sum(fire == NOBODY for fire in owners.values()),
            ids_given=len(self._ids),
        )

    def _points_at(self, frame: SceneFrame, estimates: Sequence[TargetEstimate]) -> list[int]:
        """Of each report the fire that it points at, or NOBODY."""
        if not estimates:
            return []
        pose = frame.true_pose
        places = np.stack([one.position_enu_m for one in estimates], axis=1)
        far_m = np.full((len(self._fires), places.shape[1]), np.inf)
        for index, fire in enumerate(self._fires):
            source = fire.source.at(pose.stamp_s)
            least, most = fire.direction_box(pose)
            directions = directions_from(pose.position_enu_m, places, source)
            is_near = (directions >= (least - GATE_RAD)[:, None]) & (directions <= (most + GATE_RAD)[:, None])
            distance_m = np.hypot(*(places - source[:, None])[:2])
            far_m[index] = np.where(is_near.all(axis=0), distance_m, np.inf)
        nearest = far_m.argmin(axis=0)
        fires, reports = np.nonzero(np.isfinite(far_m))
        is_believed = np.array([one.state in BELIEVED for one in estimates])[reports]
        scores = np.where(is_believed, _ANY_M2 - np.square(far_m[fires, reports]), 0.0)
        own = best_pairs(scores, reports, fires)
        nearest[reports[own]] = fires[own]
        return [int(fire) if np.isfinite(far_m[fire, i]) else NOBODY for i, fire in enumerate(nearest)]

    def _row(self, frame: SceneFrame, one: TargetEstimate, points_at: int) -> _Row:
        sources = [fire.source.at(frame.true_pose.stamp_s) for fire in self._fires]
        ranges_m = np.array([horizontal_error_m(frame.true_pose.position_enu_m, source) for source in sources])
        offsets_m = [(source - one.position_enu_m)[:2] for source in sources]
        errors_m = np.array([horizontal_error_m(one.position_enu_m, source) for source in sources])
        return _Row(
            step=len(self._stamps_s),
            id=one.id,
            observations=one.observations,
            points_at=points_at if one.state is TargetState.CONFIRMED else None,
            is_inside=np.array([ellipse_holds(one.ellipse95, offset_m) for offset_m in offsets_m]),
            nees=np.array([nees(offset_m, one.covariance_enu_m2[:2, :2]) for offset_m in offsets_m]),
            error_share=errors_m / ranges_m,
            half_share=one.ellipse95.semi_major_m / ranges_m,
        )

    def _owners(self) -> dict[int, int]:
        """Each confirmed target's fire; of as many votes NOBODY, then the first fire, has it."""
        votes: dict[int, Counter[int]] = {}
        for row in self._rows:
            counted = votes.setdefault(row.id, Counter())
            if row.points_at is not None:
                counted[row.points_at] += 1
        return {
            id_: min(counted, key=lambda fire: (-counted[fire], fire), default=NOBODY) for id_, counted in votes.items()
        }
