"""The picture itself: takes what zenoh brought, keeps no more than it may, and says what changed. Free of I/O."""

from collections.abc import Set
from typing import Literal

import msgspec

from service.common.shown import shown
from service.ground.picture.drone import NAME_CHARACTERS, Drone
from service.ground.picture.fires import Fires
from service.ground.picture.fleet import Fleet
from service.ground.picture.fused.fusion import Asked, Compared, Fusion, compared
from service.ground.picture.fused.told import fused_fire, fused_view, shared_tower
from service.ground.picture.fused.towers import Alert
from service.ground.picture.marks import Mark, Marks
from service.ground.picture.previews import MOST_PREVIEW_BYTES
from service.ground.picture.sharing import Shared, ToldUids, key_parts
from service.ground.picture.views import Changed, FireView, GroundView, News
from service.ground.subscriber import report_or_fault
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import Outvoted, SharedFire
from service.publish.wire import StatusReport, VehicleReport

MOST_BYTES = 64_000  # of a message; ours have 2 kB, a status 5
COMPARE_S = 1.0  # how often `compare` is called
_JPEG = b"\xff\xd8\xff"


class Picture:
    """Drones, fires and marks, each bounded; what had no place is counted in `GroundView.left_out`."""

    def __init__(self) -> None:
        self.marks = Marks()
        self.ground = GroundView()
        self.fusion = Fusion()
        self._fires = Fires(self.marks, lambda vehicle: self._fleet.by_name[vehicle].clock)
        self._fleet = Fleet(self._fires.forget_drone)
        self._told = ToldUids()

    def hear(self, key: str, payload: bytes, now_s: float, sender: str = "") -> bool:
        """A message on `distloc/VEHICLE/...`; whether it could be used. What could not is counted by drone."""
        vehicle, kind, number = key_parts(key)
        if kind == "marks":
            return self._hear_mark(vehicle, number, payload, now_s)
        if kind == "alerts":
            return self.fusion.towers.hear(vehicle, payload, now_s, self._fleet.places())
        if kind == "fused":
            return False  # a ground's own word, in a record: it is made anew
        drone = self._fleet.heard(vehicle, now_s)
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
        drone = self._fleet.heard(key_parts(key)[0], now_s)
        if drone is not None:
            drone.is_alive = is_there

    def refuse(self, vehicle: str, reason: str, count: int, now_s: float) -> None:
        """Messages that never came so far."""
        drone = self._fleet.heard(shown(vehicle, most=NAME_CHARACTERS), now_s)
        if drone is not None:
            drone.refuse(reason, count)

    def mark(self, mark: Mark, now_s: float) -> Mark | None:
        """Somebody's word at this ground, as it is to be told to the others; None where there is no such fire."""
        ids = self._fires.of_number(mark.number)
        fire_id = ids[-1] if ids and mark.first_drone_s is None else self._fires.meant(mark)
        if fire_id is None:
            return None
        firsts_s = self._fires.by_id[fire_id].firsts_s
        said = msgspec.structs.replace(
            mark,
            name=shown(mark.name, most=NAME_CHARACTERS),
            first_drone_s=firsts_s[-1] if firsts_s else None,
        )
        dated = self.marks.dated(said, now_s)
        self.marks.take(dated, now_s)
        self._fires.changed.add(fire_id)
        return dated

    def preview(self, name: str) -> bytes | None:
        """The last annotated JPEG of a vehicle, or of a fire: the last one that was taken while it was seen."""
        joined, previews = self.fusion.joined.get(name), self._fires.previews
        if joined is not None:
            name = max(joined.fire.used, key=lambda one: previews.taken_s(one) or 0.0)
        return previews.jpeg(name)

    def take_alert(self, payload: bytes, now_s: float) -> Alert | str:
        """A tower's alert that is to be heard, or why it cannot be used, which is counted."""
        alert = self.fusion.towers.alert_or_fault(payload, now_s, self._fleet.places())
        if isinstance(alert, str):
            self.fusion.towers.refuse(alert)
        return alert

    def fused(self, now_s: float) -> list[FireView]:
        """The fires that several tell of."""
        return self._news("all", self.fusion.joined.keys(), frozenset(), now_s).fires

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much: nothing is older or fresher for that."""
        if step_s != 0.0:
            self._fleet.set_clock_on(step_s)
            self._fires.set_clock_on(step_s)
            self.fusion.set_clock_on(step_s)

    def compare(self, now_s: float) -> None:
        """Fuse anew what several drones and towers tell of one fire; call it about once a second.

        It may take half a second with a hundred drones: who has others waiting calls the three steps of it.
        """
        self.take_compared(compared(self.to_compare(now_s)))

    def to_compare(self, now_s: float) -> Asked:
        """For `compared` in another thread."""
        self.fusion.towers.check(self._fleet.places())
        own, drones = self._fires, self._fleet.by_name
        fires = {one: fire for one, fire in own.by_id.items() if not (own.is_no_fire(one) or own.is_earlier(fire))}
        age_s = {one: fire.age_s(drones[fire.vehicle].clock, now_s) for one, fire in fires.items()}
        by_terrain = frozenset(one.name for one in drones.values() if one.is_by_terrain)
        return self.fusion.asked(fires, age_s, by_terrain, now_s)

    def take_compared(self, found: Compared) -> None:
        """What came of it; of fires that are gone meanwhile nothing is shown."""
        self._fires.changed |= self.fusion.take(found)

    def whole(self, now_s: float) -> News:
        """All of it."""
        fires = self._fires.by_id.keys() | self.fusion.joined.keys()
        return self._news("all", fires, self._fleet.by_name.keys(), now_s)

    def changed(self) -> Changed:
        """Names of what changed since this was asked for last."""
        fires = self._fires.changed
        fused = {self.fusion.fused_of[one] for one in fires if one in self.fusion.fused_of}
        changed = Changed(frozenset(fires | fused), frozenset(self._fleet.changed))
        self._fires.changed, self._fleet.changed = set(), set()
        return changed

    def news(self, changed: Changed, now_s: float) -> News:
        """Those as they are now, and which of them are gone."""
        return self._news("news", changed.fires, changed.drones, now_s)

    def changes(self, now_s: float) -> News:
        """Both in one."""
        return self.news(self.changed(), now_s)

    def shared(self, now_s: float) -> Shared:
        """As other programs are told: each fire once, a fused one in place of its parts; the most urgent first."""
        ids = self._fires.by_id.keys() | self.fusion.joined.keys()
        drones = self._shared_drones(self._fleet.by_name.keys(), now_s)
        fires = self._shared_fires(ids)
        towers = [shared_tower(one, fires) for one in self.fusion.towers.views()]
        return Shared(list(fires.values()), drones, towers)

    def shared_news(self, changed: Changed, now_s: float) -> Shared:
        """What of that is news; for one reader, who is told each time what he knows and is no more."""
        fires = self._shared_fires(changed.fires)
        gone = self._told.gone(changed.fires, {one: fire.uid for one, fire in fires.items()})
        return Shared(list(fires.values()), self._shared_drones(changed.drones, now_s), gone=gone)

    def _shared_fires(self, ids: Set[str]) -> dict[str, SharedFire]:
        found = {one: shared for one in ids if (shared := self._shared(one)) is not None}
        return {one: found[one] for one in sorted(found, key=lambda one: (self._key(one), one), reverse=True)}

    def _key(self, one: str) -> tuple[int, float]:
        joined = self.fusion.joined.get(one)
        own = (one,) if joined is None else joined.fire.used
        return max(self._fires.by_id[name].key for name in own if name in self._fires.by_id)

    def _shared(self, one: str) -> SharedFire | None:
        """None for a part of a fused fire: that stands for it."""
        joined, fires = self.fusion.joined.get(one), self._fires
        if joined is not None:
            view = self._view(one)
            is_no_fire = all(fires.is_no_fire(name) for name in joined.fire.used if name in fires.by_id)
            return None if view is None else fused_fire(view, joined, fires.by_id, is_no_fire)
        fire = fires.by_id.get(one)
        if fire is None or one in self.fusion.fused_of:
            return None
        clock = self._fleet.by_name[fire.vehicle].clock
        return fire.shared(clock, fires.mark_of(one), fires.is_earlier(fire), self._outvoted(one))

    def _outvoted(self, one: str) -> Outvoted | None:
        by = self.fusion.outvoted_by.get(one)
        if by is None:
            return None
        fire = self.fusion.joined[by].fire
        label = self._fires.by_id[fire.used[0]].number if fire.used[0] in self._fires.by_id else fire.used[0]
        return Outvoted(label, next(word.away_m for word in fire.outvoted if word.name == one))

    def _shared_drones(self, names: Set[str], now_s: float) -> list[SharedDrone]:
        drones = self._fleet.by_name
        return [one for name in sorted(names & drones.keys()) if (one := drones[name].shared(now_s)) is not None]

    def _news(self, kind: Literal["all", "news"], fires: Set[str], drones: Set[str], now_s: float) -> News:
        known, towers = self._fleet.by_name, self.fusion.towers
        return News(
            kind=kind,
            now_s=now_s,
            fires=[view for one in sorted(fires) if (view := self._view(one)) is not None],
            drones=[known[one].view(now_s) for one in sorted(drones) if one in known],
            gone_fires=sorted(fires - self._fires.by_id.keys() - self.fusion.joined.keys()),
            gone_drones=sorted(drones - known.keys()),
            towers=towers.views(),
            fronts=self.fusion.fronts,
            ground=msgspec.structs.replace(
                self.ground,
                left_out=self._fires.left_out + self._fleet.left_out + self.fusion.left_out,
                alerts_refused=dict(towers.refused),
            ),
        )

    def _view(self, one: str) -> FireView | None:
        joined, fire = self.fusion.joined.get(one), self._fires.by_id.get(one)
        if joined is not None:
            names = (*joined.fire.used, *joined.fire.undecided)
            members = [view for name in names if (view := self._view(name)) is not None]
            is_known = any(view.id in joined.fire.used for view in members)
            return fused_view(one, joined, members, self.fusion.twins_of(one)) if is_known else None
        if fire is None:
            return None
        view = fire.view(
            one,
            self._fleet.by_name[fire.vehicle].clock,
            self._fires.mark_of(one),
            self.fusion.twins_of(one),
            self._fires.previews.taken_s(one),
            self._fires.is_earlier(fire),
        )
        fused, by = self.fusion.fused_of.get(one, ""), self.fusion.outvoted_by.get(one, "")
        return msgspec.structs.replace(view, fused=fused, outvoted_by=by) if fused or by else view

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
            self._fires.changed |= set(self._fires.of_drone(drone.name))
        return None

    def _take_report(self, drone: Drone, number: str, payload: bytes, now_s: float) -> str | None:
        report = report_or_fault(payload)
        if isinstance(report, str):
            return "not readable"
        said = report.properties
        if shown(said.vehicle, most=NAME_CHARACTERS) != drone.name or str(said.target) != number:
            return "of another name than its key"
        self._fires.take(report, drone.name, now_s)
        return None

    def _take_preview(self, drone: Drone, payload: bytes, now_s: float) -> str | None:
        if len(payload) > MOST_PREVIEW_BYTES:
            return "too large"
        if not payload.startswith(_JPEG):
            return "not readable"
        self._fires.take_preview(payload, drone.name, now_s)
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
        self._fires.changed |= set(self._fires.of_number(mark.number))
        return True
