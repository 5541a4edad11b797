"""The drones' own fires of the picture, by id, with what was said of each; bounded. Free of I/O."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from service.ground.picture.clock import DroneClock
from service.ground.picture.fire import Fire, fire_of
from service.ground.picture.fused.twins import Shapes
from service.ground.picture.marks import Mark, Marks, order
from service.ground.picture.previews import Previews
from service.publish.wire import Report

MOST_FIRES, MOST_FIRES_EACH = 2_000, 64
_UNTOLD_S = 10.0  # a drone tells of each of its fires once a second


class Fires:
    """`changed` has the ids of which there is news; a fire that had to go is counted in `left_out`.

    `clock_of` gives a drone's clock by the drone's name.
    """

    def __init__(self, marks: Marks, clock_of: Callable[[str], DroneClock]) -> None:
        self.by_id: dict[str, Fire] = {}
        self.previews = Previews()
        self.changed: set[str] = set()
        self.left_out = 0
        self._marks, self._clock_of = marks, clock_of
        self._succeeded: frozenset[str] = frozenset()  # uids
        self._ids: dict[str, list[str]] = {}  # of the fires of one number, which begin anew with each flight

    def take(self, report: Report, vehicle: str, now_s: float) -> None:
        """A drone's word on one of its targets; late copies, the cache's and the queryable's, are passed over."""
        number = f"{vehicle}/{report.properties.target}"
        fire_id = self._id_of(number, report, now_s)
        before = self.by_id.get(fire_id)
        if before is not None and before.is_after(report):
            return
        self.by_id[fire_id] = fire_of(report, before, now_s, vehicle)
        self.changed.add(fire_id)
        if before is None:
            ids = self._ids.setdefault(number, [])
            ids.append(fire_id)
            self.changed |= set(ids)  # those before are earlier ones now
            self._make_room(vehicle)

    def take_preview(self, jpeg: bytes, vehicle: str, now_s: float) -> None:
        """The drone's last picture, and that of each fire that it has in view."""
        clock = self._clock_of(vehicle)
        seen = {one for one in self.of_drone(vehicle) if self.by_id[one].is_seen(clock, now_s)}
        self.previews.take((vehicle, *seen), jpeg, now_s)
        self.changed |= seen

    def of_drone(self, vehicle: str) -> list[str]:
        """Ids of its fires."""
        return [one for one, fire in self.by_id.items() if fire.vehicle == vehicle]

    def of_number(self, number: str) -> list[str]:
        """Ids of all that were `VEHICLE/TARGET`, the latest last."""
        return self._ids.get(number, [])

    def forget_drone(self, vehicle: str) -> None:
        """All that it told of."""
        self.previews.forget(vehicle)
        for fire_id in self.of_drone(vehicle):
            self._drop(fire_id)

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        for one, fire in self.by_id.items():
            self.by_id[one] = replace(fire, arrived_s=fire.arrived_s + step_s, since_s=fire.since_s + step_s)
        self.previews.set_clock_on(step_s)
        self.changed |= self.by_id.keys()

    def succeed(self) -> None:
        """See anew which fires a drone told of anew, in one place under another number, once it told of them no more.

        So it is where its service started without its state.
        """
        shapes = Shapes.of(self.by_id)
        fires = [self.by_id[one] for one in shapes.ids]
        own: dict[str, list[int]] = {}
        for i, fire in enumerate(fires):
            own.setdefault(fire.vehicle, []).append(i)
        pairs = [
            (i, j)
            for rows in own.values()
            for i in rows
            for j in rows
            if fires[j].since_s > fires[i].arrived_s and fires[j].arrived_s > fires[j].since_s + _UNTOLD_S
        ]
        first, second = np.array(pairs, np.intp).reshape(-1, 2).T
        is_one = shapes.meet(first, second)
        found = frozenset(fires[i].uid for i in first[is_one])
        self.changed |= {
            one for one, fire in self.by_id.items() if (fire.uid in found) != (fire.uid in self._succeeded)
        }
        self._succeeded = found

    def is_earlier(self, fire: Fire) -> bool:
        """Whether its number became another fire's, or the fire another number's, after its own last word."""
        return fire.uid in self._succeeded or any(
            self.by_id[one].since_s > fire.arrived_s for one in self._ids[fire.number]
        )

    def is_no_fire(self, fire_id: str) -> bool:
        """As the crew says."""
        mark = self.mark_of(fire_id)
        return mark is not None and mark.verdict == "not_a_fire"

    def mark_of(self, fire_id: str) -> Mark | None:
        """The latest word on it."""
        marks = self._marks.of(self.by_id[fire_id].number)
        return max((one for one in marks if self.meant(one) == fire_id), key=order, default=None)

    def meant(self, mark: Mark) -> str | None:
        """The id of the fire that a mark is of: of those that may be, the one that came last."""
        for one in reversed(self.of_number(mark.number)):
            fire = self.by_id[one]
            if fire.is_meant_by(mark, self._clock_of(fire.vehicle)):
                return one
        return None

    def _id_of(self, number: str, report: Report, now_s: float) -> str:
        """Of the fire that it is of: the number, and for a further fire of that number also when it was first seen."""
        ids = self.of_number(number)
        for one in reversed(ids):
            if self.by_id[one].is_same(report, now_s):
                return one
        first = re.sub("[^0-9T]", "", (report.properties.first_seen_utc or "")[:19])
        return f"{number}/{first}" if ids else number

    def _make_room(self, vehicle: str) -> None:
        own = {one: self.by_id[one] for one in self.of_drone(vehicle)}
        crowd = own if len(own) > MOST_FIRES_EACH else self.by_id if len(self.by_id) > MOST_FIRES else {}
        if crowd:
            self._drop(min(crowd, key=lambda one: (not self.is_earlier(crowd[one]), crowd[one].key)))
            self.left_out += 1

    def _drop(self, fire_id: str) -> None:
        number = self.by_id.pop(fire_id).number
        self._ids[number].remove(fire_id)
        if not self._ids[number]:
            del self._ids[number]
        self.previews.forget(fire_id)
        self.changed.add(fire_id)
