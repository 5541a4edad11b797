"""Which track each segment goes to; the tracker asks."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from distloc.filter.bank import Bank
from distloc.filter.settings import LocalizerConfig
from distloc.geometry.camera import Camera
from distloc.sights.sight import Sight
from distloc.sights.sights import Expected, Ray, most_off_px
from distloc.tracks.assignment.clutter import CLUTTER_DENSITY, Clutter
from distloc.tracks.assignment.matching import best_pairs
from distloc.tracks.assignment.shift import DECIDED, LEAST_RAD, Carried, Pairs, carried, judged
from distloc.tracks.expected import VIEW_MARGIN, InView, may_be
from distloc.tracks.looks.first_look import least_log_density, without_choice
from distloc.tracks.looks.looks import Looks
from distloc.tracks.target_track import Track
from distloc.types import BoolArray, CameraPose, FloatArray, PoseErrors

_HIDDEN = -2.0  # the logarithm of how likely what is in view and was not seen a step before shows again


@dataclass(frozen=True, slots=True)
class Pair:
    """A track's detection: how far it is from what is expected (2,), and the square by the covariance of that."""

    detection: int
    sight: Sight
    innovation: FloatArray
    squared: float


@dataclass(frozen=True, slots=True)
class Assignment:
    """Each track's detection, all detections that are used, and what waits with one that may be another's.

    What the frame tells of the attitude, for those that it does not show; None where it shows none that is believed.
    """

    taken: dict[Track, Pair] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)
    waiting: set[Track] = field(default_factory=set)
    carried: Carried | None = None


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
    drift: FloatArray,
) -> Assignment:
    """One detection at most to each track, so that all together are likeliest; those told of before the others.

    The tracks are in the order of their places, and `view` is of them. `clutter` is of false segments in a frame;
    `drift` (3, 3) is how far the attitude's error may have gone since a target was last seen. What this platform never
    saw may be less likely than false segments are, where there is no choice but that.
    """
    if not tracks or not rays:
        return Assignment()
    places = np.array([track.filter.place for track in tracks])
    expected = looks.expected(places, pose, view.range_m)
    by_track, by_ray = np.nonzero(_can_be(bank, looks, places, expected, pose, errors, rays, config))
    if by_track.size == 0:
        return Assignment()
    sights = looks.found([rays[index] for index in by_ray], expected.chosen(by_track))
    fit = bank.compare(places[by_track], sights)
    by_bias = sights.by_nuisance[:, :, :3].mean(axis=0)  # the rays of a picture lie close
    common = by_bias @ drift @ by_bias.T + (errors.attitude_white_rad**2 + LEAST_RAD**2) * np.eye(2)
    room = _room(tracks, view, clutter.camera)
    likely = fit.log_likelihood - np.log(clutter.density)
    is_hidden = np.array([track.unseen_steps > 0 for track in tracks]) & (np.nan_to_num(room, nan=-1.0) > 0.0).all(
        axis=(1, 2)
    )
    likely[is_hidden[by_track]] += _HIDDEN
    told = judged(Pairs(by_track, by_ray, fit, likely), common, room)
    is_new = ~looks.is_seen[looks.own[places]][by_track]
    scores = told.scores
    if is_new.any() and clutter.density <= CLUTTER_DENSITY:  # not in a flood of false segments
        least = least_log_density(bank, places, pose, clutter.camera)[by_track]
        raised = np.where(is_new, np.maximum(scores, fit.log_likelihood - least), scores)
        scores = np.where(without_choice(raised > 0.0, by_track, by_ray), raised, scores)
    is_told = np.array([track.life is not None for track in tracks])[by_track]
    chosen, is_open = _chosen(scores, told.is_open, is_told, by_track, by_ray)
    waits = [index for index in chosen if is_open[index] and tracks[by_track[index]].may_wait()]
    found = [index for index in chosen if index not in waits]
    telling = [index for index in found if tracks[by_track[index]].is_believed]
    return Assignment(
        taken={
            tracks[by_track[index]]: Pair(
                int(by_ray[index]), sights.one(index), fit.innovation[index], float(fit.squared[index])
            )
            for index in found
        },
        used=set(by_ray[chosen].tolist()),
        waiting={tracks[by_track[index]] for index in waits},
        carried=carried(told, telling, common, drift, by_bias) if telling else None,
    )


def _can_be(
    bank: Bank,
    looks: Looks,
    places: NDArray[np.intp],
    expected: Expected,
    pose: CameraPose,
    errors: PoseErrors,
    rays: list[Ray],
    config: LocalizerConfig,
) -> BoolArray:
    """(places, rays): whether a segment lies where the target may be, and is no larger than it may look."""
    sizes_px, most_px = np.array([ray.size_px for ray in rays]), looks.sizes.most_px[looks.own[places]]
    middles_px = most_off_px(rays, expected.size_px, config.pixel_sigma_px)
    frame_rad = np.sqrt(expected.white(errors) + expected.scatter.max(axis=1))
    sigma_rad = np.hypot(middles_px * np.array([ray.px_rad for ray in rays]), frame_rad[:, None])
    return may_be(bank, places, pose, rays, sigma_rad) & (sizes_px <= most_px[:, None]).all(axis=2)


def _chosen(
    scores: FloatArray, is_open: BoolArray, is_told: BoolArray, by_track: NDArray[np.intp], by_ray: NDArray[np.intp]
) -> tuple[list[int], BoolArray]:
    """The pairs (p,) that are likeliest together, of targets that were told first; and which of all are not decided."""
    by_told = np.where(is_told, scores, 0.0)
    chosen = best_pairs(by_told, by_track, by_ray)
    is_open = is_open | _has_rivals(by_told, by_track, by_ray, chosen)
    is_left = ~is_told & ~np.isin(by_ray, by_ray[chosen])
    return chosen + best_pairs(np.where(is_left, scores, 0.0), by_track, by_ray), is_open


def _has_rivals(
    scores: FloatArray, by_track: NDArray[np.intp], by_ray: NDArray[np.intp], chosen: list[int]
) -> BoolArray:
    """Which of the chosen pairs (p,) may be others: without it the best is hardly less likely, and uses its ray."""
    found, able, total = np.zeros(scores.size, np.bool_), scores > 0.0, float(scores[chosen].sum())
    for index in chosen:
        if np.count_nonzero(able & (by_ray == by_ray[index])) == 1:
            continue
        others = np.where(np.arange(scores.size) == index, 0.0, scores)
        second = best_pairs(others, by_track, by_ray)
        found[index] = total - others[second].sum() < DECIDED and by_ray[index] in by_ray[second]
    return found


def _room(tracks: Sequence[Track], view: InView, camera: Camera) -> FloatArray:
    """How far inside the picture (tracks, 2, 2) those that are told of and must show are expected, in tangents."""
    focal_px, size_px = np.array([camera.fx, -camera.fy]), np.array([camera.width, camera.height])
    margin_px = VIEW_MARGIN * size_px
    pixel = view.pixel.copy()
    pixel[[track.life is None for track in tracks]] = np.nan
    corners = np.stack(
        [pixel - [margin_px[0], size_px[1] - margin_px[1]], [size_px[0] - margin_px[0], margin_px[1]] - pixel], axis=1
    )
    return np.asarray(corners / focal_px)
