"""One sequence watched at one threshold: when the fire was told of, and how often something was before it began."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.geometry.camera import Camera
from distloc.sights.detections import detections_from_mask
from distloc.study.alerts.places import LEVELS, SEGMENT, FixedCamera, Place
from distloc.study.segmentation import Truth, is_near
from distloc.types import Detection, MaskArray, RejectReason

_MOST_SEEN = 256  # places before the ignition, the last of them
LONGEST_GAP_S = 600.0  # between two frames, beyond which nobody watched


@dataclass(frozen=True, slots=True)
class Watched:
    """What became of a sequence, by level: `after_s` since the ignition, NaN where it was not told of or never lit.

    `false` counts what rose to a level before the ignition, in `hours` of watching. `frames` are those before and
    after.
    """

    after_s: tuple[float, ...]
    false: tuple[int, ...]
    hours: float
    frames: tuple[int, int]


class SequenceWatch:
    """Takes a fixed camera's frames in order of time; at the ignition it begins anew.

    Up to the ignition, that frame included, all that is told of is false. After it a level is reached when a place that
    has it is seen on the smoke; where the truth is unknown, at any place at which nothing was seen before.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._before, self._after = FixedCamera(camera.width), FixedCamera(camera.width)
        self._false = np.zeros(len(LEVELS), dtype=int)
        self._after_s = np.full(len(LEVELS), np.nan)
        self._frames = [0, 0]
        self._watched_s = 0.0
        self._last_s: float | None = None
        self._seen_before: deque[Place] = deque(maxlen=_MOST_SEEN)

    def frame(
        self, since_ignition_s: float, mask: MaskArray | RejectReason, truth: Truth | None, has_truth: bool
    ) -> None:
        """A segmenter's mask of a frame, or its refusal, which counts as no segments."""
        segments = [] if isinstance(mask, RejectReason) else detections_from_mask(mask, self._camera)
        if since_ignition_s <= 0.0:
            self._watch(since_ignition_s, segments)
            return
        self._frames[1] += 1
        for seen in self._after.step(segments):
            if self._is_smoke(seen.segment, truth, has_truth):
                reached = np.arange(len(LEVELS)) <= seen.place.level
                self._after_s[reached & np.isnan(self._after_s)] = since_ignition_s

    def watched(self) -> Watched:
        """All of it."""
        return Watched(
            tuple(self._after_s.tolist()),
            tuple(self._false.tolist()),
            self._watched_s / 3600.0,
            (self._frames[0], self._frames[1]),
        )

    def _watch(self, since_ignition_s: float, segments: Sequence[Detection]) -> None:
        self._frames[0] += 1
        if self._last_s is not None and since_ignition_s - self._last_s <= LONGEST_GAP_S:
            self._watched_s += since_ignition_s - self._last_s
        self._last_s = since_ignition_s
        for seen in self._before.step(segments):
            if seen.has_risen:
                self._false[seen.place.level] += 1
                if seen.place.level == SEGMENT:
                    self._seen_before.append(seen.place)

    def _is_smoke(self, segment: Detection, truth: Truth | None, has_truth: bool) -> bool:
        if has_truth:
            return truth is not None and is_near(truth, segment.centre_px, self._camera)
        return not any(
            (np.abs(segment.centre_px - place.centre_px) <= place.half_px).all() for place in self._seen_before
        )
