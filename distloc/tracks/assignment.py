"""Which track each segment goes to; the tracker asks."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.bank import Bank
from distloc.geometry.camera import Camera
from distloc.localizer_config import LocalizerConfig
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, most_off_px
from distloc.tracks.expected import InView, may_be
from distloc.tracks.life import CONFIRM_SIGHTINGS
from distloc.tracks.looks.first_look import least_log_density, without_choice
from distloc.tracks.looks.looks import Looks
from distloc.tracks.target_track import Track
from distloc.types import CameraPose, FloatArray, PoseErrors

CLUTTER_DENSITY = 1.0  # false segments expected in a frame, for each unit of tangent squared: about one in the image
_LATELY = 0.1  # of what the last frame says
_APART_STEPS = CONFIRM_SIGHTINGS  # with a segment each


@dataclass(frozen=True, slots=True)
class Pair:
    """A track's detection: how far it is from what is expected (2,), and the square by the covariance of that."""

    detection: int
    sight: Sight
    innovation: FloatArray
    squared: float


class Clutter:
    """How dense false segments lie, as the frames of late show it: in a flood of them a match must be closer.

    Otherwise segments that have nothing to do with each other pass for one thing, near by, that was seen often.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._image = camera.width / camera.fx * camera.height / camera.fy
        self._number = 0.0  # in a frame

    @property
    def density(self) -> float:
        """By tangent squared, at the least what one in the image is."""
        return max(CLUTTER_DENSITY, self._number / self._image)

    def learn(self, number: int) -> None:
        """So many segments of a frame belong to nothing that was seen often."""
        self._number += _LATELY * (number - self._number)


class Apart:
    """Which targets were seen beside each other, and so are two, by the places of their filters.

    Ranges that a common error of the heading blurs say little of whether two targets are one. That both had a segment
    of their own in the same frames does: it is forgotten again where one is in the other's segment, as a piece is that
    comes off now and then, but not any more once it was so for as long as a confirmation takes.
    """

    def __init__(self, places: int) -> None:
        self._steps = np.zeros((places, places), np.int8)

    def seen(self, tracks: Collection[Track]) -> None:
        """All these had a segment of their own in this frame."""
        places = [one.filter.place for one in tracks]
        at = np.ix_(places, places)
        self._steps[at] = np.minimum(self._steps[at] + 1, _APART_STEPS)

    def share(self, one: int, other: int) -> None:
        """One is in the segment of the other."""
        if not self.are(one, other):
            self._steps[one, other] = self._steps[other, one] = max(self._steps[one, other] - 1, 0)

    def are(self, one: int, other: int) -> bool:
        """Whether they are two."""
        return bool(self._steps[one, other] >= _APART_STEPS)

    def part(self, places: Sequence[int]) -> None:
        """All these are known to be two by two."""
        self._steps[np.ix_(places, places)] = _APART_STEPS

    def join(self, one: int, other: int) -> None:
        """They are the same, and go on at the second's place."""
        self._steps[other] = np.maximum(self._steps[one], self._steps[other])
        self._steps[:, other] = self._steps[other]

    def keep(self, places: Sequence[int]) -> None:
        """Only these are in use; what comes to the others is new."""
        is_free = np.ones(len(self._steps), np.bool_)
        is_free[list(places)] = False
        self._steps[is_free], self._steps[:, is_free] = 0, 0


def assigned(
    bank: Bank,
    looks: Looks,
    tracks: Sequence[Track],
    view: InView,
    pose: CameraPose,
    errors: PoseErrors,
    rays: list[Ray],
    config: LocalizerConfig,
    clutter: Clutter,
) -> dict[Track, Pair]:
    """One detection at most to each track, the best matches first, those told of before the others.

    The tracks are in the order of their places, and `view` is of them. `clutter` is of false segments in a frame. What
    this platform never saw may be less likely than they are, where there is no choice but that.
    """
    if not tracks or not rays:
        return {}
    places = np.array([track.filter.place for track in tracks])
    sizes_px = np.array([ray.size_px for ray in rays])
    most_px, expected = looks.sizes.most_px[looks.own[places]], looks.expected(places, pose, view.range_m)
    middles_px = most_off_px(rays, expected.size_px, config.pixel_sigma_px)
    frame_rad = np.sqrt(expected.white(errors) + expected.scatter.max(axis=1))
    sigma_rad = np.hypot(middles_px * np.array([ray.px_rad for ray in rays]), frame_rad[:, None])
    can_be = may_be(bank, places, pose, rays, sigma_rad) & (sizes_px <= most_px[:, None]).all(axis=2)
    by_track, by_ray = np.nonzero(can_be)
    if by_track.size == 0:
        return {}
    sights = looks.found([rays[index] for index in by_ray], expected.chosen(by_track))
    fit = bank.compare(places[by_track], sights)
    scores = fit.log_likelihood - np.log(clutter.density)
    is_new = ~looks.is_seen[looks.own[places]][by_track]
    if is_new.any() and clutter.density <= CLUTTER_DENSITY:  # not in a flood of false segments
        least = least_log_density(bank, places, pose, clutter.camera)[by_track]
        raised = np.where(is_new, np.maximum(scores, fit.log_likelihood - least), scores)
        scores = np.where(without_choice(raised > 0.0, by_track, by_ray), raised, scores)
    is_told = np.array([track.life is not None for track in tracks])[by_track]
    taken: dict[Track, Pair] = {}
    used: set[int] = set()
    for index in np.lexsort((-scores, ~is_told)).tolist():
        track, detection = tracks[by_track[index]], int(by_ray[index])
        if scores[index] > 0.0 and track not in taken and detection not in used:
            innovation, squared = fit.innovation[index], float(fit.squared[index])
            taken[track] = Pair(detection, sights.one(index), innovation, squared)
            used.add(detection)
    return taken
