"""The places of targets whose sightings are known, each with what the others tell of the platforms' errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.ground_weights import ground_weights
from distloc.batch.lines import IntArray, Lines, lines_of
from distloc.batch.place import Place
from distloc.batch.posterior import Cloud, LogWeights, posterior
from distloc.batch.scales import SCALES, Scale
from distloc.batch.sighting import Sighting
from distloc.batch.smoke import widened
from distloc.batch.summary import place_of
from distloc.batch.views import Alone, Company, Seen, likely_scales, settled, sigma_share
from distloc.filter.ground import Ground
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray, PoseErrors

_ENOUGH = 400  # sightings, for whom one look is enough
MOST_COMPANY = 8  # other targets that tell of the platforms' errors
MOST_SHARED, _MOST_TELLING = 240, 120  # sightings of all these and the target's, and of these alone
_MOST_BEND_RAD = 3e-3  # of such a target: its place is known to 3 % of its range
_WORTH_SETTLING = 0.2  # the same, by its own sightings alone
_AGAINST = 4.5  # standard deviations by which a ground may contradict the sightings
_AS_FAR = 0.05  # a logarithm of ranges
_SMALL_RAD = 3e-4  # of a position's error, seen from the target


@dataclass(frozen=True, slots=True)
class Scene:
    """What all places are found by: the sightings with who carried each, and the ground."""

    sightings: Sequence[Sighting]
    carriers: Sequence[str]
    frame: LocalFrame
    errors: PoseErrors
    ground: Ground
    range_m: tuple[float, float]

    def lines(self, group: Sequence[int]) -> Lines:
        """Those of some sightings."""
        own = [self.sightings[i] for i in group]
        lines = lines_of(own, [self.carriers[i] for i in group], self.frame, self.errors)
        lines.index[:] = np.array(group, dtype=np.intp)[lines.index]
        return lines


@dataclass(frozen=True, slots=True)
class Found:
    """A target with its lines and about where it is; `against` are platforms that do not bear it out."""

    target: str
    lines: Lines
    point: FloatArray
    carriers: frozenset[str]
    against: tuple[str, ...] = ()

    @property
    def is_sure(self) -> bool:
        """Whether its place is known well enough to tell its platforms' errors from it."""
        if len(self.lines) < 2:
            return False
        range_m = float(self.lines.ranges_m(self.point[None]).min())
        return sigma_share(Alone(self.lines, SCALES[0], self.point), self.point, range_m) < _WORTH_SETTLING


class Placing:
    """Places of what was found, any of them by itself."""

    def __init__(self, scene: Scene, found: Sequence[Found]) -> None:
        self._scene, self._found = scene, found
        self._sure = [one for one in found if not one.against and len(one.lines) <= MOST_SHARED and one.is_sure]

    def places(self, numbers: Sequence[int]) -> tuple[list[Place], list[str]]:
        """Those of some of what was found, and what is to be said of them."""
        notes: list[str] = []
        return [self._place(one, self._company(one), notes) for one in (self._found[i] for i in numbers)], notes

    def _company(self, one: Found) -> Company | None:
        """Others that its platforms see too, those with the most pictures in common first."""
        pictures = self._pictures_of(one)
        others = [other for other in self._sure if other is not one and other.carriers & one.carriers]
        shared = [(-len(pictures & self._pictures_of(other)), other.target) for other in others]
        by_name = {other.target: other for other in self._sure}
        chosen = [by_name[name] for _, name in sorted(shared)[:MOST_COMPANY]]
        room = min(_MOST_TELLING, MOST_SHARED - len(one.lines))
        if not chosen or room < len(chosen):
            return None
        chosen = [self._telling(other, pictures, room // len(chosen)) for other in chosen]
        alone = likely_scales(one.lines, None, one.point)[0]
        settling = [*chosen, one] if any(other is one for other in self._sure) else chosen
        known = settled(self._together(settling, None), alone)
        linear = np.flatnonzero(known.bend_rad[: len(chosen)] < _MOST_BEND_RAD)
        if not len(linear):
            return None
        company = self._together([chosen[i] for i in linear], one)
        return replace(company, points_enu_m=known.points_enu_m[linear], bend_rad=known.bend_rad[linear])

    def _telling(self, other: Found, pictures: set[tuple[str, float]], most: int) -> Found:
        """Another with so many of its sightings: of pictures that both are in as far as there are, evenly over them."""
        if len(other.lines) <= most:
            return other
        stamps = zip(other.lines.index.tolist(), other.lines.stamp_s.tolist(), strict=True)
        is_common = np.array([(self._scene.carriers[i], stamp_s) in pictures for i, stamp_s in stamps])
        first, rest = np.flatnonzero(is_common), np.flatnonzero(~is_common)
        kept = np.zeros(len(is_common), np.bool_)
        kept[_evenly(first, most)] = True
        kept[_evenly(rest, most - int(kept.sum()))] = True
        return replace(other, lines=other.lines.of(kept))

    def _together(self, chosen: list[Found], one: Found | None) -> Company:
        """Sightings of `chosen`, each somebody's, and those of `one`, which are nobody's."""
        everybody = chosen if one is None else [*chosen, one]
        lines = self._scene.lines([i for found in everybody for i in found.lines.index.tolist()])
        whose = {i: number for number, found in enumerate(chosen) for i in found.lines.index.tolist()}
        which = np.array([whose.get(i, -1) for i in lines.index.tolist()], dtype=np.intp)
        return Company(lines, which, np.stack([found.point for found in chosen]), np.zeros(len(chosen)))

    def _pictures_of(self, one: Found) -> set[tuple[str, float]]:
        stamps = zip(one.lines.index.tolist(), one.lines.stamp_s.tolist(), strict=True)
        return {(self._scene.carriers[i], stamp_s) for i, stamp_s in stamps if not np.isnan(stamp_s)}

    def _place(self, one: Found, company: Company | None, notes: list[str]) -> Place:
        own = one.lines
        doubt = np.square(own.mark).sum(axis=1) + np.square(own.attitude_white) + own.bias_variance.sum(axis=1)
        origin = int(np.lexsort((own.ranges_m(one.point[None])[:, 0], doubt))[0])
        weights = ground_weights(self._scene.ground, own.position_enu_m[origin])
        clouds, scales = self._clouds(own, origin, one.point, company, weights)
        if weights is not None and _is_against(one, company, clouds[0], scales[0]):
            notes.append(
                f"{one.target}: the ground is over {_AGAINST} standard deviations from where it is seen: not used"
            )
            weights = None
            clouds, scales = self._clouds(own, origin, one.point, company, weights)
        names = tuple(sorted(one.carriers))
        scene = self._scene
        place = place_of(one.target, own, origin, names, clouds, scales, scene.frame, weights is not None, scene.errors)
        bearing = replace(place.bearing, platform=scene.carriers[place.bearing.index])
        return widened(replace(place, bearing=bearing, against=one.against), scene.sightings)

    def _clouds(
        self, own: Lines, origin: int, point: FloatArray, company: Company | None, weights: LogWeights | None
    ) -> tuple[list[Cloud], list[Scale]]:
        """A cloud for each size of the white errors that may be."""
        scales = likely_scales(own, company, point)
        clouds = []
        for scale in scales:
            near = point
            for _ in range(2):  # positions' errors are angles once ranges are known
                cloud = posterior(own, origin, near, scale, company, self._scene.range_m, weights)
                before, near = near, np.asarray(cloud.weights @ cloud.points_enu_m)
                if len(own) > _ENOUGH or _are_as_far(own, before, near):
                    break
            clouds.append(cloud)
        return clouds, scales


def _are_as_far(lines: Lines, one: FloatArray, other: FloatArray) -> bool:
    """Whether the positions' errors are the same angles at both places, or next to nothing."""
    range_m = lines.ranges_m(np.stack([one, other]))
    angles = lines.position_m[:, None] / np.maximum(range_m, 1.0)
    return bool((angles < _SMALL_RAD).all() or (np.abs(np.diff(np.log(range_m), axis=1)) < _AS_FAR).all())


def _evenly(these: IntArray, most: int) -> IntArray:
    """At most so many of them."""
    if len(these) <= most:
        return these
    return these[np.unique(np.linspace(0, len(these) - 1, max(most, 0)).astype(np.intp))]


def _is_against(one: Found, company: Company | None, cloud: Cloud, scale: Scale) -> bool:
    """Whether the ground holds a place where the sightings cannot have it."""
    best = cloud.points_enu_m[int(np.argmax(cloud.weights))]
    views = Seen(one.lines, company, one.point).views(scale)
    with_ground, without = np.square(views.white(np.stack([best, one.point]))).sum(axis=0)
    return bool(with_ground - without > _AGAINST**2)
