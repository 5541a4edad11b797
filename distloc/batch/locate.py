"""Places from a table of sightings: `locate` is the package's front door for who has them all at once."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from distloc.batch.belonging.association import NOBODY, associated
from distloc.batch.belonging.carriers import carriers_of, duplicates_of
from distloc.batch.belonging.members import Members, members_of
from distloc.batch.lines import Lines, frame_of
from distloc.batch.place import LEAST_MORE, Located, Place, Rejected, Unused
from distloc.batch.placing import Found, Placing, Scene
from distloc.batch.sighting import CONSUMER_ERRORS, Sighting
from distloc.filter.ground import Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from distloc.types import BoolArray, FloatArray, PoseErrors

MOST_SIGHTINGS = 100_000
_LEAST_OF_ANOTHER = 3  # sightings that nobody named make a second place: two lines of sight always cross nearly
_MOST_ALONE = 8
_PARTS = 8  # into about so many the work is divided, each of one target or more

T = TypeVar("T")
R = TypeVar("R")


class Each(Protocol):
    """Who does independent parts of the work: one by one, or in processes, with the results in the parts' order."""

    def __call__(
        self, function: Callable[[T], R], tasks: Sequence[T], /, *, on_done: Callable[[int], None]
    ) -> Iterable[R]:
        """The results of a module's own function; `on_done` gets how many tasks are done."""


def one_by_one(function: Callable[[T], R], tasks: Sequence[T], /, *, on_done: Callable[[int], None]) -> Iterator[R]:
    """In this process."""
    for number, task in enumerate(tasks, 1):
        yield function(task)
        on_done(number)


def locate(
    sightings: Sequence[Sighting],
    *,
    errors: PoseErrors = CONSUMER_ERRORS,
    ground: Callable[[LocalFrame], Ground] | None = None,
    range_m: tuple[float, float] = (10.0, 60_000.0),
    on_done: Callable[[int], None] = lambda done: None,
    each: Each = one_by_one,
) -> Located:
    """Where the targets are that these sightings show, any number from any platforms in any order.

    `errors` are those of sightings that bring none of their own. `ground` gives the ground in the frame that it is
    handed; without one, and without parallax, a place is a bearing. Sightings that name their `target` make a place
    each name; of the others those belong together that agree. `on_done` is told of how many sightings the work is done;
    `each` does its parts, and the answer is the same whoever does. ValueError where there are none or too many.
    """
    if not 1 <= len(sightings) <= MOST_SIGHTINGS:
        raise ValueError(f"locate needs 1 to {MOST_SIGHTINGS} sightings, got {len(sightings)}")
    if not 0.0 < range_m[0] < range_m[1] < np.inf:
        raise ValueError(f"range_m must rise above 0, got {range_m}")
    frame = frame_of(sightings)
    carriers, notes = carriers_of(sightings)
    scene = Scene(tuple(sightings), tuple(carriers), frame, errors, ground(frame) if ground else NoGround(), range_m)
    repeated = duplicates_of(sightings)
    groups: dict[str | None, list[int]] = {}
    for i, one in enumerate(sightings):
        if i not in repeated:
            groups.setdefault(one.target, []).append(i)
    names = sorted(groups, key=lambda name: (name is None, name or ""))
    solver = _Solver(scene, notes)
    parts = _parts([scene.lines(groups[name]) for name in names])
    half = 0.5 * len(sightings)  # the other half of the work are the places
    taken = each(_members, [(part, range_m) for part in parts], on_done=lambda n: on_done(int(half * n / len(parts))))
    lines = (one for part in parts for one in part)
    for name, own, members in zip(names, lines, (one for part in taken for one in part), strict=True):
        solver.solve(name, own, members)
    placing, shares = Placing(scene, solver.found), _parts(range(len(solver.found)))
    places: list[Place] = []
    tasks = [(placing, share) for share in shares]
    for found, said in each(_places, tasks, on_done=lambda n: on_done(int(half * (1 + n / len(tasks))))):
        places += found
        notes += said
    rejected = [Rejected(i, Unused.DUPLICATE, other=other) for i, other in repeated.items()] + solver.rejected
    rejected.sort(key=lambda one: one.index)
    return Located(tuple(places), tuple(rejected), tuple(notes), frame)


def _parts(all_of: Sequence[T]) -> list[Sequence[T]]:
    """So many that progress shows and processes share them, so few that what they have in common is sent seldom."""
    size = max(1, -(-len(all_of) // _PARTS))
    return [all_of[i : i + size] for i in range(0, len(all_of), size)]


def _members(part: tuple[Sequence[Lines], tuple[float, float]]) -> list[Members]:
    return [members_of(lines, part[1]) for lines in part[0]]


def _places(part: tuple[Placing, Sequence[int]]) -> tuple[list[Place], list[str]]:
    return part[0].places(part[1])


class _Solver:
    """Takes the groups one by one and gathers what comes out."""

    def __init__(self, scene: Scene, notes: list[str]) -> None:
        self.rejected: list[Rejected] = []
        self.found: list[Found] = []
        self._scene, self._notes = scene, notes

    def solve(self, target: str | None, lines: Lines, taken: Members) -> None:
        """Places of one target's sightings, or of all those that nobody named."""
        count = int(taken.is_member.sum())
        if count == 1 and len(lines) > 1:
            self._alone(target, lines, taken)
            return
        if target is not None:
            self._named(target, lines, taken)
            return
        if count == 2 and len(lines) >= 4:  # lines of sight to two things cross in four places
            self._reject(lines, _nobody(taken.point_enu_m, len(lines)), Unused.AMBIGUOUS)
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
            taken = members_of(left, self._scene.range_m)
            if taken.is_member.sum() < _LEAST_OF_ANOTHER:
                break
        label, points, doubted = associated(lines, label, points)
        first, last = len(self.found), 0
        for j in np.unique(label[label != NOBODY]).tolist():
            if j in doubted:
                self._reject(lines.of(label == j), _nobody(points[j], int((label == j).sum())), Unused.AMBIGUOUS)
            else:
                self._add(self._number(), lines, label == j, points[j])
                last = j
        is_stray = label == NOBODY
        if is_stray.any():
            those = is_stray | (label == last) & (last not in doubted)
            beside = replace(_nobody(points[last], int(those.sum())), is_member=label[those] == last)
            self._reject(lines.of(those), beside, Unused.MISFIT)
            strays = self._counts(lines, is_stray & ~_is_in_picture(lines, label == last))
            self.found[first:] = [_contradicted(one, strays) for one in self.found[first:]]

    def _named(self, target: str, lines: Lines, taken: Members) -> None:
        """The place of one target, and where too few platforms agree the others that as many may mean."""
        told: list[Members] = []
        first = self._against(lines, taken)
        agreeing = sorted(set(self._counts(lines, taken.is_member)) - set(first))
        if first and len(agreeing) - len(first) < LEAST_MORE:
            for name in agreeing:
                others = lines.of(np.array([self._scene.carriers[i] != name for i in lines.index.tolist()]))
                rival = members_of(others, self._scene.range_m)
                is_member = np.isin(lines.index, others.index[rival.is_member])
                whole = Members(rival.point_enu_m, is_member, taken.squared, rival.score)
                if len(self._counts(lines, is_member)) > 1 and not set(first) <= set(self._against(lines, whole)):
                    told.append(whole)
        by_members = {one.is_member.tobytes(): one for one in [*reversed(told), taken]}
        for one in reversed(by_members.values()):
            self._add(target, lines, one.is_member, one.point_enu_m, self._against(lines, one))
        is_told = np.logical_or.reduce([one.is_member for one in [taken, *told]])
        self._reject(lines, replace(taken, is_member=is_told), Unused.MISFIT)

    def _against(self, lines: Lines, taken: Members) -> tuple[str, ...]:
        """Platforms of which as many sightings or more look elsewhere as at the place; a picture shows that once."""
        strays = self._counts(lines, ~taken.is_member & ~_is_in_picture(lines, taken.is_member))
        used = self._counts(lines, taken.is_member)
        return tuple(sorted(name for name, count in strays.items() if count >= used[name]))

    def _counts(self, lines: Lines, chosen: BoolArray) -> Counter[str]:
        """Of how many of them each platform has."""
        return Counter(self._scene.carriers[i] for i in lines.index[chosen].tolist())

    def _alone(self, target: str | None, lines: Lines, taken: Members) -> None:
        """No two agree, and nobody knows which is right: each is told by itself, up to so many."""
        self._notes.append(f"{target or 'unnamed'}: no two of {len(lines)} sightings agree: each is told by itself")
        is_told = np.arange(len(lines)) < _MOST_ALONE
        for i in np.flatnonzero(is_told):
            ahead = lines.position_enu_m[i] + 1e3 * lines.direction_enu[i]
            self._add(target or self._number(), lines, np.arange(len(lines)) == i, ahead)
        self._reject(lines, Members(taken.point_enu_m, is_told, taken.squared, 0.0), Unused.AMBIGUOUS)

    def _number(self) -> str:
        taken = {one.target for one in self.found}
        return next(name for number in range(1, len(taken) + 2) if (name := str(number)) not in taken)

    def _add(
        self, target: str, lines: Lines, is_member: BoolArray, point: FloatArray, against: tuple[str, ...] = ()
    ) -> None:
        own = lines.of(is_member)
        carriers = frozenset(self._scene.carriers[i] for i in own.index.tolist())
        self.found.append(Found(target, own, point, carriers, against))

    def _reject(self, lines: Lines, taken: Members, reason: Unused) -> None:
        beside = np.degrees(np.linalg.norm(lines.residuals(taken.point_enu_m[None])[:, :, 0], axis=1))
        pictures = {
            (int(lines.platform[i]), float(lines.stamp_s[i])): int(lines.index[i])
            for i in np.flatnonzero(taken.is_member)
        }
        for i in np.flatnonzero(~taken.is_member):
            other = pictures.get((int(lines.platform[i]), float(lines.stamp_s[i])))
            why = Unused.SAME_PICTURE if other is not None and reason is Unused.MISFIT else reason
            self.rejected.append(Rejected(int(lines.index[i]), why, float(beside[i]), other))


def _nobody(point_enu_m: FloatArray, count: int) -> Members:
    """Of so many lines none at a point."""
    return Members(point_enu_m, np.zeros(count, np.bool_), np.zeros(count), 0.0)


def _is_in_picture(lines: Lines, is_member: BoolArray) -> BoolArray:
    """Which (N,) are of a picture that shows the place: what else it shows is something else."""
    return np.isin(lines.picture, lines.picture[is_member])


def _contradicted(one: Found, strays: Counter[str]) -> Found:
    """With the platforms that look elsewhere, where it is no craft by itself that bears the place out."""
    used = Counter(one.lines.platform.tolist())
    for platform, count in used.items():
        if count >= _LEAST_OF_ANOTHER and np.ptp(one.lines.position_enu_m[one.lines.platform == platform]) > 1.0:
            return one
    return replace(one, against=tuple(sorted(set(strays) - one.carriers)))
