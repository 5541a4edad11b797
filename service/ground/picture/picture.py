"""The picture itself: takes what zenoh brought, keeps no more than it may, and says what changed. Free of I/O."""

import re
from collections import OrderedDict
from collections.abc import Set
from dataclasses import replace
from typing import Literal

import msgspec

from service.common.shown import shown
from service.ground.picture.drone import NAME_CHARACTERS, STAYS, Drone
from service.ground.picture.fire import Fire, fire_of
from service.ground.picture.fused import Fusion, fused_view
from service.ground.picture.marks import Mark, Marks, order
from service.ground.picture.previews import MOST_PREVIEW_BYTES, Previews
from service.ground.picture.sharing import Shared, key_parts
from service.ground.picture.towers import Alert
from service.ground.picture.views import Changed, FireView, GroundView, News
from service.ground.subscriber import report_or_fault
from service.publish.wire import Report, StatusReport, VehicleReport

MOST_DRONES, MOST_FIRES, MOST_FIRES_EACH = 128, 2_000, 64
MOST_BYTES = 64_000  # of a message; ours have 2 kB, a status 5
COMPARE_S = 1.0  # how often `compare` is called
_JPEG = b"\xff\xd8\xff"


class Picture:
    """Drones, fires and marks, each bounded; what had no place is counted in `left_out`."""

    def __init__(self) -> None:
        self.marks = Marks()
        self.ground = GroundView()
        self.left_out = 0
        self._drones: OrderedDict[str, Drone] = OrderedDict()  # the one heard last is last
        self._fires: dict[str, Fire] = {}
        self._ids: dict[str, list[str]] = {}  # of the fires of one number, which begin anew with each flight
        self._previews = Previews()
        self.fusion = Fusion()
        self._changed_drones: set[str] = set()
        self._changed_fires: set[str] = set()

    def hear(self, key: str, payload: bytes, now_s: float, sender: str = "") -> bool:
        """A message on `distloc/VEHICLE/...`; whether it could be used. What could not is counted by drone."""
        vehicle, kind, number = key_parts(key)
        if kind == "marks":
            return self._hear_mark(vehicle, number, payload, now_s)
        if kind == "alerts":
            return self.fusion.towers.hear(vehicle, payload, now_s, self.places())
        if kind == "fused":
            return False  # a ground's own word, in a record: it is made anew
        drone = self._drone(vehicle, now_s)
        if drone is None:
            return False
        drone.sent_by(sender, now_s)
        fault = self._fault_of(drone, kind, number, payload, now_s)
        if fault is None:
            drone.told_s = now_s
        else:
            drone.refuse(fault)
        return fault is None

    def alive(self, key: str, is_there: bool, now_s: float) -> None:
        """A liveliness token came or went."""
        drone = self._drone(key_parts(key)[0], now_s)
        if drone is not None:
            drone.is_alive = is_there

    def refuse(self, vehicle: str, reason: str, count: int, now_s: float) -> None:
        """Messages that never came so far."""
        drone = self._drone(shown(vehicle, most=NAME_CHARACTERS), now_s)
        if drone is not None:
            drone.refuse(reason, count)

    def mark(self, mark: Mark, now_s: float) -> Mark | None:
        """Somebody's word at this ground, as it is to be told to the others; None where there is no such fire."""
        ids = self._ids.get(mark.number, [])
        fire_id = ids[-1] if ids and mark.first_drone_s is None else self._meant(mark)
        if fire_id is None:
            return None
        firsts_s = self._fires[fire_id].firsts_s
        said = msgspec.structs.replace(
            mark,
            name=shown(mark.name, most=NAME_CHARACTERS),
            first_drone_s=firsts_s[-1] if firsts_s else None,
        )
        dated = self.marks.dated(said, now_s)
        self.marks.take(dated, now_s)
        self._changed_fires.add(fire_id)
        return dated

    def preview(self, name: str) -> bytes | None:
        """The last annotated JPEG of a vehicle, or of a fire: the last one that was taken while it was seen."""
        joined = self.fusion.joined.get(name)
        if joined is not None:
            name = max(joined.fire.used, key=lambda one: self._previews.taken_s(one) or 0.0)
        return self._previews.jpeg(name)

    def places(self) -> list[tuple[float, float]]:
        """Where drones are, in degrees."""
        return [drone.place for drone in self._drones.values() if drone.place is not None]

    def take_alert(self, payload: bytes, now_s: float) -> Alert | str:
        """A tower's alert that is to be heard, or why it cannot be used, which is counted."""
        alert = self.fusion.towers.alert_or_fault(payload, now_s, self.places())
        if isinstance(alert, str):
            self.fusion.towers.refuse(alert)
        return alert

    def fused(self, now_s: float) -> list[FireView]:
        """The fires that several tell of."""
        return self._news("all", self.fusion.joined.keys(), frozenset(), now_s).fires

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much: nothing is older or fresher for that."""
        if step_s == 0.0:
            return
        for drone in self._drones.values():
            drone.set_clock_on(step_s)
        for one, fire in self._fires.items():
            self._fires[one] = replace(fire, arrived_s=fire.arrived_s + step_s, since_s=fire.since_s + step_s)
        self._previews.set_clock_on(step_s)
        self.fusion.set_clock_on(step_s)
        self._changed_drones |= self._drones.keys()
        self._changed_fires |= self._fires.keys()

    def compare(self, now_s: float) -> None:
        """Fuse anew what several drones and towers tell of one fire; call it about once a second."""
        fires = {
            one: fire for one, fire in self._fires.items() if not (self._is_no_fire(one) or self._is_earlier(fire))
        }
        age_s = {one: fire.age_s(self._drones[fire.vehicle].clock, now_s) for one, fire in fires.items()}
        by_terrain = frozenset(one.name for one in self._drones.values() if one.is_by_terrain)
        self._changed_fires |= self.fusion.compare(fires, age_s, by_terrain, now_s)

    def whole(self, now_s: float) -> News:
        """All of it."""
        return self._news("all", self._fires.keys() | self.fusion.joined.keys(), self._drones.keys(), now_s)

    def changed(self) -> Changed:
        """Names of what changed since this was asked for last."""
        fused = {self.fusion.fused_of[one] for one in self._changed_fires if one in self.fusion.fused_of}
        changed = Changed(frozenset(self._changed_fires | fused), frozenset(self._changed_drones))
        self._changed_fires, self._changed_drones = set(), set()
        return changed

    def news(self, changed: Changed, now_s: float) -> News:
        """Those as they are now, and which of them are gone."""
        return self._news("news", changed.fires, changed.drones, now_s)

    def changes(self, now_s: float) -> News:
        """Both in one."""
        return self.news(self.changed(), now_s)

    def shared(self, now_s: float, changed: Changed | None = None) -> Shared:
        """All, or those, as other programs are told; the most urgent fire first."""
        fires = self._fires.keys() if changed is None else changed.fires & self._fires.keys()
        drones = self._drones.keys() if changed is None else changed.drones & self._drones.keys()
        found = sorted(((self._fires[one], one) for one in fires), key=lambda one: one[0].key, reverse=True)
        return Shared(
            [one.shared(self._drones[one.vehicle].clock, self._mark_of(i), self._is_earlier(one)) for one, i in found],
            [one for name in sorted(drones) if (one := self._drones[name].shared(now_s)) is not None],
        )

    def _news(self, kind: Literal["all", "news"], fires: Set[str], drones: Set[str], now_s: float) -> News:
        return News(
            kind=kind,
            now_s=now_s,
            fires=[view for one in sorted(fires) if (view := self._view(one)) is not None],
            drones=[self._drones[one].view(now_s) for one in sorted(drones) if one in self._drones],
            gone_fires=sorted(fires - self._fires.keys() - self.fusion.joined.keys()),
            gone_drones=sorted(drones - self._drones.keys()),
            towers=self.fusion.towers.views(),
            fronts=self.fusion.fronts,
            ground=msgspec.structs.replace(
                self.ground,
                left_out=self.left_out + self.fusion.left_out,
                alerts_refused=dict(self.fusion.towers.refused),
            ),
        )

    def _view(self, one: str) -> FireView | None:
        joined, fire = self.fusion.joined.get(one), self._fires.get(one)
        if joined is not None:
            names = (*joined.fire.used, *joined.fire.undecided)
            members = [view for name in names if (view := self._view(name)) is not None]
            is_known = any(view.id in joined.fire.used for view in members)
            return fused_view(one, joined, members, self.fusion.twins_of(one)) if is_known else None
        if fire is None:
            return None
        view = fire.view(
            one,
            self._drones[fire.vehicle].clock,
            self._mark_of(one),
            self.fusion.twins_of(one),
            self._previews.taken_s(one),
            self._is_earlier(fire),
        )
        fused, by = self.fusion.fused_of.get(one, ""), self.fusion.outvoted_by.get(one, "")
        return msgspec.structs.replace(view, fused=fused, outvoted_by=by) if fused or by else view

    def _is_earlier(self, fire: Fire) -> bool:
        """Whether its number became another fire's after its own last word."""
        return any(self._fires[one].since_s > fire.arrived_s for one in self._ids[fire.number])

    def _mark_of(self, fire_id: str) -> Mark | None:
        """The latest word on it."""
        marks = self.marks.of(self._fires[fire_id].number)
        return max((one for one in marks if self._meant(one) == fire_id), key=order, default=None)

    def _meant(self, mark: Mark) -> str | None:
        """The id of the fire that a mark is of: of those that may be, the one that came last."""
        for one in reversed(self._ids.get(mark.number, ())):
            fire = self._fires[one]
            if fire.is_meant_by(mark, self._drones[fire.vehicle].clock):
                return one
        return None

    def _is_no_fire(self, fire_id: str) -> bool:
        mark = self._mark_of(fire_id)
        return mark is not None and mark.verdict == "not_a_fire"

    def _drone(self, vehicle: str, now_s: float) -> Drone | None:
        """Made where it is new; None where all places are taken by drones that go on telling."""
        drone = self._drones.get(vehicle)
        if drone is None:
            if len(self._drones) >= MOST_DRONES and not self._make_place(now_s):
                self.left_out += 1
                return None
            drone = self._drones[vehicle] = Drone(vehicle, now_s)
        self._drones.move_to_end(vehicle)
        drone.heard_s = now_s
        self._changed_drones.add(vehicle)
        return drone

    def _make_place(self, now_s: float) -> bool:
        """Forget the drone that is missed least, of several the one heard longest ago."""
        least = min(self._drones.values(), key=lambda one: one.is_missed(now_s))
        if least.is_missed(now_s) == STAYS:
            return False
        self._forget(least.name)
        return True

    def _forget(self, vehicle: str) -> None:
        """A drone with its fires."""
        del self._drones[vehicle]
        self._previews.forget(vehicle)
        self._changed_drones.add(vehicle)
        for fire_id in [one for one, fire in self._fires.items() if fire.vehicle == vehicle]:
            self._drop(fire_id)
        self.left_out += 1

    def _fault_of(self, drone: Drone, kind: str, number: str, payload: bytes, now_s: float) -> str | None:
        """Take it; or why not."""
        if kind == "preview":
            return self._take_preview(drone, payload, now_s)
        if len(payload) > MOST_BYTES:
            return "too large"
        if kind == "targets":
            return self._take_report(drone, number, payload, now_s)
        try:
            if kind == "status":
                is_other = drone.status(msgspec.json.decode(payload, type=StatusReport), now_s)
            elif kind == "vehicle":
                is_other = drone.vehicle(msgspec.json.decode(payload, type=VehicleReport), now_s)
            else:
                return "of no known kind"
        except (msgspec.MsgspecError, RecursionError):
            return "not readable"
        if is_other:  # its fires' times read differently now
            self._changed_fires |= {one for one, fire in self._fires.items() if fire.vehicle == drone.name}
        return None

    def _take_report(self, drone: Drone, number: str, payload: bytes, now_s: float) -> str | None:
        report = report_or_fault(payload)
        if isinstance(report, str):
            return "not readable"
        said = report.properties
        if shown(said.vehicle, most=NAME_CHARACTERS) != drone.name or str(said.target) != number:
            return "of another name than its key"
        fire_id = self._id_of(f"{drone.name}/{number}", report, now_s)
        before = self._fires.get(fire_id)
        if before is not None and before.is_after(report):
            return None  # the cache's and the queryable's copies come late
        self._fires[fire_id] = fire_of(report, before, now_s, drone.name)
        self._changed_fires.add(fire_id)
        if before is None:
            ids = self._ids.setdefault(f"{drone.name}/{number}", [])
            ids.append(fire_id)
            self._changed_fires |= set(ids)  # those before are earlier ones now
            self._make_room(drone.name)
        return None

    def _id_of(self, number: str, report: Report, now_s: float) -> str:
        """Of the fire that it is of: the number, and for a further fire of that number also when it was first seen."""
        ids = self._ids.get(number, [])
        for one in reversed(ids):
            if self._fires[one].is_same(report, now_s):
                return one
        first = re.sub("[^0-9T]", "", (report.properties.first_seen_utc or "")[:19])
        return f"{number}/{first}" if ids else number

    def _make_room(self, vehicle: str) -> None:
        own = {one: fire for one, fire in self._fires.items() if fire.vehicle == vehicle}
        crowd = own if len(own) > MOST_FIRES_EACH else self._fires if len(self._fires) > MOST_FIRES else {}
        if crowd:
            self._drop(min(crowd, key=lambda one: (not self._is_earlier(crowd[one]), crowd[one].key)))
            self.left_out += 1

    def _drop(self, fire_id: str) -> None:
        number = self._fires.pop(fire_id).number
        self._ids[number].remove(fire_id)
        if not self._ids[number]:
            del self._ids[number]
        self._previews.forget(fire_id)
        self._changed_fires.add(fire_id)

    def _take_preview(self, drone: Drone, payload: bytes, now_s: float) -> str | None:
        if len(payload) > MOST_PREVIEW_BYTES:
            return "too large"
        if not payload.startswith(_JPEG):
            return "not readable"
        seen = {
            one for one, fire in self._fires.items() if fire.vehicle == drone.name and fire.is_seen(drone.clock, now_s)
        }
        self._previews.take((drone.name, *seen), payload, now_s)
        self._changed_fires |= seen
        drone.preview_s = now_s
        return None

    def _hear_mark(self, vehicle: str, number: str, payload: bytes, now_s: float) -> bool:
        if len(payload) > MOST_BYTES:
            return False
        try:
            mark = msgspec.json.decode(payload, type=Mark)
        except (msgspec.MsgspecError, RecursionError):
            return False
        mark = msgspec.structs.replace(mark, name=shown(mark.name, most=NAME_CHARACTERS))
        if (mark.vehicle, str(mark.target)) != (vehicle, number) or not self.marks.take(mark, now_s):
            return False
        self._changed_fires |= set(self._ids.get(mark.number, ()))
        return True
