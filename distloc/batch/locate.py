"""Places from a table of sightings: `locate` is the package's front door for who has them all at once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.association import NOBODY, associated
from distloc.batch.carriers import carriers_of, duplicates_of
from distloc.batch.ground_weights import ground_weights
from distloc.batch.lines import IntArray, Lines, frame_of, lines_of
from distloc.batch.members import Members, members_of
from distloc.batch.place import Located, Place, Rejected, Unused
from distloc.batch.posterior import Cloud, LogWeights, posterior
from distloc.batch.scales import SCALES, Scale
from distloc.batch.sighting import CONSUMER_ERRORS, Sighting
from distloc.batch.summary import place_of
from distloc.batch.views import Alone, Company, Seen, likely_scales, settled, sigma_share
from distloc.filter.ground import Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from distloc.types import BoolArray, FloatArray, PoseErrors

MOST_SIGHTINGS = 100_000
_LEAST_OF_ANOTHER = 3  # sightings that nobody named make a second place: two lines of sight always cross nearly
_MOST_ALONE = 8
_MOST_TOLD_APART = 6  # places that nobody named
_ENOUGH = 400  # sightings, for whom one look is enough
MOST_COMPANY = 8  # other targets that tell of the platforms' errors
MOST_SHARED, _MOST_TELLING = 240, 120  # sightings of all these and the target's, and of these alone
_MOST_BEND_RAD = 3e-3  # of such a target: its place is known to 3 % of its range
_WORTH_SETTLING = 0.2  # the same, by its own sightings alone
_AGAINST = 4.5  # standard deviations by which a ground may contradict the sightings
_AS_FAR = 0.05  # a logarithm of ranges
_SMALL_RAD = 3e-4  # of a position's error, seen from the target


def locate(
    sightings: Sequence[Sighting],
    *,
    errors: PoseErrors = CONSUMER_ERRORS,
    ground: Callable[[LocalFrame], Ground] | None = None,
    range_m: tuple[float, float] = (10.0, 60_000.0),
    on_done: Callable[[int], None] = lambda done: None,
) -> Located:
    """Where the targets are that these sightings show, any number from any platforms in any order.

    `errors` are those of sightings that bring none of their own. `ground` gives the ground in the frame that it is
    handed; without one, and without parallax, a place is a bearing. Sightings that name their `target` make a place
    each name; of the others those belong together that agree. `on_done` is told of how many sightings the work is done.
    ValueError where there are none or too many.
    """
    if not 1 <= len(sightings) <= MOST_SIGHTINGS:
        raise ValueError(f"locate needs 1 to {MOST_SIGHTINGS} sightings, got {len(sightings)}")
    if not 0.0 < range_m[0] < range_m[1] < np.inf:
        raise ValueError(f"range_m must rise above 0, got {range_m}")
    frame = frame_of(sightings)
    solver = _Solver(sightings, frame, errors, ground(frame) if ground else NoGround(), range_m)
    repeated = duplicates_of(sightings)
    groups: dict[str | None, list[int]] = {}
    for i, one in enumerate(sightings):
        if i not in repeated:
            groups.setdefault(one.target, []).append(i)
    asked = 0
    for target in sorted(groups, key=lambda name: (name is None, name or "")):
        solver.solve(target, groups[target])
        asked += len(groups[target])
        on_done(asked // 2)  # the other half of the work are the places
    for used in solver.finish():
        asked += used
        on_done(min(asked // 2, len(sightings)))
    rejected = [Rejected(i, Unused.DUPLICATE, other=other) for i, other in repeated.items()] + solver.rejected
    rejected.sort(key=lambda one: one.index)
    return Located(tuple(solver.places), tuple(rejected), tuple(solver.notes), frame)


@dataclass(frozen=True, slots=True)
class _Found:
    """A target with its lines and about where it is."""

    target: str
    lines: Lines
    point: FloatArray
    carriers: frozenset[str]

    @property
    def is_sure(self) -> bool:
        """Whether its place is known well enough to tell its platforms' errors from it."""
        if len(self.lines) < 2:
            return False
        range_m = float(self.lines.ranges_m(self.point[None]).min())
        return sigma_share(Alone(self.lines, SCALES[0], self.point), self.point, range_m) < _WORTH_SETTLING


class _Solver:
    """Takes the groups one by one and gathers what comes out."""

    def __init__(
        self,
        sightings: Sequence[Sighting],
        frame: LocalFrame,
        errors: PoseErrors,
        ground: Ground,
        range_m: tuple[float, float],
    ) -> None:
        self.places: list[Place] = []
        self.rejected: list[Rejected] = []
        self._sightings, self._frame, self._errors, self._ground = sightings, frame, errors, ground
        self._range_m = range_m
        self._found: list[_Found] = []
        self._carriers, self.notes = carriers_of(sightings)

    def solve(self, target: str | None, group: list[int]) -> None:
        """Places of one target's sightings, or of all those that nobody named."""
        lines = self._lines(group)
        taken = members_of(lines, self._range_m)
        count = int(taken.is_member.sum())
        if count == 1 and len(lines) > 1:
            self._alone(target, lines, taken)
            return
        if target is not None:
            self._add(target, lines, taken.is_member, taken.point_enu_m)
            self._reject(lines, taken.is_member, taken.point_enu_m, Unused.MISFIT)
            return
        if count == 2 and len(lines) >= 4:  # lines of sight to two things cross in four places
            self._reject(lines, np.zeros(len(lines), np.bool_), taken.point_enu_m, Unused.AMBIGUOUS)
            return
        self._unnamed(lines, taken)

    def _unnamed(self, lines: Lines, taken: Members) -> None:
        """Places of what nobody named: those that most agree on first, then whose sightings are whose."""
        label = np.full(len(lines), NOBODY, dtype=np.intp)
        points: list[FloatArray] = []
        rows, left = np.arange(len(lines)), lines
        while True:
            label[rows[taken.is_member]] = len(points)
            points.append(taken.point_enu_m)
            rows, left = rows[~taken.is_member], left.of(~taken.is_member)
            if len(left) < _LEAST_OF_ANOTHER:
                break
            taken = members_of(left, self._range_m)
            if taken.is_member.sum() < _LEAST_OF_ANOTHER:
                break
        doubted: frozenset[int] = frozenset()
        if 1 < len(points) <= _MOST_TOLD_APART:
            way, doubted = associated(lines, label, np.stack(points))
            label = way.label
            points = [old if np.isnan(new).any() else new for old, new in zip(points, way.points_enu_m, strict=True)]
        told = [j for j in np.unique(label[label != NOBODY]).tolist() if j not in doubted]
        for j in told:
            self._add(self._number(), lines, label == j, points[j])
        for j in sorted(doubted):
            self._reject(lines.of(label == j), np.zeros(int((label == j).sum()), np.bool_), points[j], Unused.AMBIGUOUS)
        last = max(told, default=0)
        left = (label == NOBODY) | ((label == last) & (last in told))
        self._reject(lines.of(left), label[left] != NOBODY, points[last], Unused.MISFIT)

    def _alone(self, target: str | None, lines: Lines, taken: Members) -> None:
        """No two agree, and nobody knows which is right: each is told by itself, up to so many."""
        self.notes.append(f"{target or 'unnamed'}: no two of {len(lines)} sightings agree: each is told by itself")
        is_told = np.arange(len(lines)) < _MOST_ALONE
        for i in np.flatnonzero(is_told):
            ahead = lines.position_enu_m[i] + 1e3 * lines.direction_enu[i]
            self._add(target or self._number(), lines, np.arange(len(lines)) == i, ahead)
        self._reject(lines, is_told, taken.point_enu_m, Unused.AMBIGUOUS)

    def _lines(self, group: list[int]) -> Lines:
        own = [self._sightings[i] for i in group]
        lines = lines_of(own, [self._carriers[i] for i in group], self._frame, self._errors)
        lines.index[:] = np.array(group, dtype=np.intp)[lines.index]
        return lines

    def _number(self) -> str:
        taken = {one.target for one in self._found}
        return next(name for number in range(1, len(taken) + 2) if (name := str(number)) not in taken)

    def _add(self, target: str, lines: Lines, is_member: BoolArray, point: FloatArray) -> None:
        own = lines.of(is_member)
        self._found.append(_Found(target, own, point, frozenset(self._carriers[i] for i in own.index.tolist())))

    def finish(self) -> Iterator[int]:
        """The places of all that was found, each with what the others tell; how many sightings each rests on."""
        sure = [one for one in self._found if len(one.lines) <= MOST_SHARED and one.is_sure]
        for one in self._found:
            self.places.append(self._place(one, self._company(one, sure)))
            yield len(one.lines)

    def _company(self, one: "_Found", sure: list["_Found"]) -> Company | None:
        """Others that its platforms see too, those with the most pictures in common first."""
        pictures = self._pictures_of(one)
        others = [other for other in sure if other is not one and other.carriers & one.carriers]
        shared = [(-len(pictures & self._pictures_of(other)), other.target) for other in others]
        by_name = {other.target: other for other in sure}
        chosen = [by_name[name] for _, name in sorted(shared)[:MOST_COMPANY]]
        room = min(_MOST_TELLING, MOST_SHARED - len(one.lines))
        if not chosen or room < len(chosen):
            return None
        chosen = [self._telling(other, pictures, room // len(chosen)) for other in chosen]
        alone = likely_scales(one.lines, None, one.point)[0]
        settling = [*chosen, one] if any(other is one for other in sure) else chosen
        known = settled(self._together(settling, None), alone)
        linear = np.flatnonzero(known.bend_rad[: len(chosen)] < _MOST_BEND_RAD)
        if not len(linear):
            return None
        company = self._together([chosen[i] for i in linear], one)
        return replace(company, points_enu_m=known.points_enu_m[linear], bend_rad=known.bend_rad[linear])

    def _telling(self, other: _Found, pictures: set[tuple[str, float]], most: int) -> _Found:
        """Another with so many of its sightings: of pictures that both are in as far as there are, evenly over them."""
        if len(other.lines) <= most:
            return other
        stamps = zip(other.lines.index.tolist(), other.lines.stamp_s.tolist(), strict=True)
        is_common = np.array([(self._carriers[i], stamp_s) in pictures for i, stamp_s in stamps])
        first, rest = np.flatnonzero(is_common), np.flatnonzero(~is_common)
        kept = np.zeros(len(is_common), np.bool_)
        kept[_evenly(first, most)] = True
        kept[_evenly(rest, most - int(kept.sum()))] = True
        return replace(other, lines=other.lines.of(kept))

    def _together(self, chosen: list["_Found"], one: "_Found | None") -> Company:
        """Sightings of `chosen`, each somebody's, and those of `one`, which are nobody's."""
        everybody = chosen if one is None else [*chosen, one]
        lines = self._lines([i for found in everybody for i in found.lines.index.tolist()])
        whose = {i: number for number, found in enumerate(chosen) for i in found.lines.index.tolist()}
        which = np.array([whose.get(i, -1) for i in lines.index.tolist()], dtype=np.intp)
        return Company(lines, which, np.stack([found.point for found in chosen]), np.zeros(len(chosen)))

    def _pictures_of(self, one: "_Found") -> set[tuple[str, float]]:
        stamps = zip(one.lines.index.tolist(), one.lines.stamp_s.tolist(), strict=True)
        return {(self._carriers[i], stamp_s) for i, stamp_s in stamps if not np.isnan(stamp_s)}

    def _place(self, one: "_Found", company: Company | None) -> Place:
        own = one.lines
        doubt = np.square(own.mark).sum(axis=1) + np.square(own.attitude_white) + own.bias_variance.sum(axis=1)
        origin = int(np.lexsort((own.ranges_m(one.point[None])[:, 0], doubt))[0])
        weights = ground_weights(self._ground, own.position_enu_m[origin])
        clouds, scales = self._clouds(own, origin, one.point, company, weights)
        if weights is not None and _is_against(one, company, clouds[0], scales[0]):
            self.notes.append(
                f"{one.target}: the ground is over {_AGAINST} standard deviations from where it is seen: not used"
            )
            weights = None
            clouds, scales = self._clouds(own, origin, one.point, company, weights)
        names = tuple(sorted(one.carriers))
        return place_of(one.target, own, origin, names, clouds, scales, self._frame, weights is not None, self._errors)

    def _clouds(
        self, own: Lines, origin: int, point: FloatArray, company: Company | None, weights: LogWeights | None
    ) -> tuple[list[Cloud], list[Scale]]:
        """A cloud for each size of the white errors that may be."""
        scales = likely_scales(own, company, point)
        clouds = []
        for scale in scales:
            near = point
            for _ in range(2):  # positions' errors are angles once ranges are known
                cloud = posterior(own, origin, near, scale, company, self._range_m, weights)
                before, near = near, np.asarray(cloud.weights @ cloud.points_enu_m)
                if len(own) > _ENOUGH or _are_as_far(own, before, near):
                    break
            clouds.append(cloud)
        return clouds, scales

    def _reject(self, lines: Lines, is_used: BoolArray, point: FloatArray, reason: Unused) -> None:
        beside = np.degrees(np.linalg.norm(lines.residuals(point[None])[:, :, 0], axis=1))
        pictures = {
            (int(lines.platform[i]), float(lines.stamp_s[i])): int(lines.index[i]) for i in np.flatnonzero(is_used)
        }
        for i in np.flatnonzero(~is_used):
            other = pictures.get((int(lines.platform[i]), float(lines.stamp_s[i])))
            why = Unused.SAME_PICTURE if other is not None and reason is Unused.MISFIT else reason
            self.rejected.append(Rejected(int(lines.index[i]), why, float(beside[i]), other))


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


def _is_against(one: _Found, company: Company | None, cloud: Cloud, scale: Scale) -> bool:
    """Whether the ground holds a place where the sightings cannot have it."""
    best = cloud.points_enu_m[int(np.argmax(cloud.weights))]
    views = Seen(one.lines, company, one.point).views(scale)
    with_ground, without = np.square(views.white(np.stack([best, one.point]))).sum(axis=0)
    return bool(with_ground - without > _AGAINST**2)
