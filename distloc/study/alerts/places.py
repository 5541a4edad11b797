"""Persistence at one place of a fixed camera's image, by the tracker's counts: what stands for a track without a pose.

A segment is of the place whose last box it touches, or comes near to; one for each, the nearest first. A place is
`tentative` and `confirmed` by as many sightings of its last frames as a track is, and gone after as many misses. What
a track must be beside that, on the ground and at a place that is known, one camera that stands still cannot tell.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.settings import LocalizerConfig
from distloc.tracks.life import CONFIRM_SIGHTINGS, CONFIRM_WINDOW
from distloc.tracks.pool import CANDIDATE_MISSES, REPORT_SIGHTINGS, REPORT_WINDOW
from distloc.types import Detection, FloatArray

SEGMENT, TENTATIVE, CONFIRMED = range(3)
LEVELS = ("segment", "tentative", "confirmed")
_TOLD_MISSES = LocalizerConfig().dismissal_misses
_MOST_PLACES = 256
_NEAR_PX, _NEAR_WIDTH_PX = 10.0, 512  # beside the last box, in an image of that width, as the scores have it


class Place:
    """Where segments keep coming: its last box's centre and half sizes (2,), which of its last frames had one."""

    def __init__(self) -> None:
        self.centre_px: FloatArray = np.zeros(2)
        self.half_px: FloatArray = np.zeros(2)
        self.level = SEGMENT
        self._seen: deque[bool] = deque(maxlen=CONFIRM_WINDOW)
        self._misses = 0

    def hit(self, segment: Detection) -> bool:
        """Take a segment; whether the place comes to a higher level with it, or is new."""
        is_new = not self._seen
        self.centre_px, self.half_px = segment.centre_px, _half_px(segment)
        self._seen.append(True)
        self._misses = 0
        before = self.level
        if sum(list(self._seen)[-REPORT_WINDOW:]) >= REPORT_SIGHTINGS:
            self.level = max(self.level, TENTATIVE)
        if self.level >= TENTATIVE and sum(self._seen) >= CONFIRM_SIGHTINGS:
            self.level = CONFIRMED
        return is_new or self.level > before

    def miss(self) -> None:
        """A frame without a segment here."""
        self._seen.append(False)
        self._misses += 1

    @property
    def is_over(self) -> bool:
        """Whether it was missed too often in a row."""
        return self._misses >= (CANDIDATE_MISSES if self.level == SEGMENT else _TOLD_MISSES)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A segment and its place, and whether that began or came to a higher level with it."""

    segment: Detection
    place: Place
    has_risen: bool


class FixedCamera:
    """The places of one camera; `width_px` is its image's. Frames come in the order of time."""

    def __init__(self, width_px: int) -> None:
        self._near_px = _NEAR_PX * width_px / _NEAR_WIDTH_PX
        self._places: list[Place] = []

    def step(self, segments: Sequence[Detection]) -> list[Sighting]:
        """The next frame's segments, each at its place; those that there is no place for any more are left out."""
        given: dict[int, Place] = {}
        for _, index, place in sorted(self._pairs(segments), key=lambda pair: pair[0]):
            if index not in given and place not in given.values():
                given[index] = place
        for place in self._places:
            if place not in given.values():
                place.miss()
        self._places = [place for place in self._places if not place.is_over]
        for index in range(len(segments)):
            if index not in given and len(self._places) < _MOST_PLACES:
                given[index] = Place()
                self._places.append(given[index])
        return [Sighting(segments[at], given[at], given[at].hit(segments[at])) for at in sorted(given)]

    def _pairs(self, segments: Sequence[Detection]) -> list[tuple[float, int, Place]]:
        """Distance between centres, segment and place, of those whose boxes touch or nearly do."""
        pairs = []
        for index, segment in enumerate(segments):
            for place in self._places:
                apart_px = np.abs(segment.centre_px - place.centre_px)
                if (apart_px <= _half_px(segment) + place.half_px + self._near_px).all():
                    pairs.append((float(np.hypot(*apart_px)), index, place))
        return pairs


def _half_px(segment: Detection) -> FloatArray:
    return np.array([segment.width_px, segment.height_px]) / 2.0
