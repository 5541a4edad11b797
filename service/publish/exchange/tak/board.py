"""What TAK clients should see now: the last word on each fire and drone, and what of it is due. Pure, no clock.

Nothing waits as bytes: events are made when they go out, so that none is ever old, and a server that was away gets each
fire once, as it is then. A fire that is taken back is withdrawn; so is the region of one that became stale, as ATAK
lets a marker fade and a drawing stay.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass

from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.tak import cot

LIFETIME_S = {"tentative": 60.0, "confirmed": 600.0, "coasting": 1_800.0}  # since it was seen last
DRONE_LIFETIME_S = 30.0
PERIOD_S = 10.0  # each fire again, for who came late; with over 100 fires less often
_PERIOD_OF_ONE_S = 0.1
_SOONEST_S, _DRONE_PERIOD_S = 1.0, 2.0
_REGION_PERIODS = 6  # servers keep what is not stale for who comes later, and a region has nothing but us to end it
_LAST_S = 1.0  # of a marker that is taken back, so that such a server lets it go
_WITHDRAWN_TIMES = 3  # a datagram may be lost
_URGENCY = ("dismissed", "tentative", "coasting", "confirmed")


@dataclass(slots=True)
class _Slot:
    """A fire, when it was sent last and what that said; `withdrawn` counts how often that was taken back."""

    fire: SharedFire
    sent_s: float = -math.inf
    sent: SharedFire | None = None  # None: nobody was told since the link opened
    is_on_maps: bool = False  # somebody may have it on a map
    is_region_on_maps: bool = False
    withdrawn: int = 0
    place: tuple[float, float] = (0.0, 0.0)


class Board:
    """One for each link. At most `most_fires` fires, as many that are being withdrawn, and `most_drones` drones."""

    def __init__(self, most_fires: int, most_drones: int, with_tentative: bool) -> None:
        self._most_fires, self._most_drones, self._with_tentative = most_fires, most_drones, with_tentative
        self._fires: dict[str, _Slot] = {}
        self._leaving: OrderedDict[str, _Slot] = OrderedDict()
        self._drones: OrderedDict[str, tuple[SharedDrone, float, bool]] = OrderedDict()  # when sent, whether it is news
        self.left_out = 0
        self.unplaced = 0

    @property
    def count(self) -> int:
        """Fires that are shown."""
        return len(self._fires)

    @property
    def _period_s(self) -> float:
        return max(PERIOD_S, _PERIOD_OF_ONE_S * len(self._fires))

    def tell_fire(self, fire: SharedFire) -> None:
        """The last word on a fire."""
        slot = self._fires.get(fire.uid)
        is_shown = not fire.is_withdrawn and (self._with_tentative or fire.report.properties.state != "tentative")
        if not is_shown:
            self._leave(fire.uid)
        elif fire.told_s is not None and _stale_s(fire) <= fire.told_s:
            self._expire(fire.uid)
        elif fire.place is None:
            self.unplaced += 1
        elif slot is not None:
            slot.fire = fire
        elif len(self._fires) < self._most_fires or self._make_room(fire):
            left = self._leaving.pop(fire.uid, None)
            self._fires[fire.uid] = _Slot(fire, is_on_maps=left is not None, is_region_on_maps=left is not None)

    def withdraw(self, uid: str) -> None:
        """There is no such fire any more: another stands for it, or it was forgotten."""
        self._leave(uid)

    def tell_drone(self, drone: SharedDrone) -> None:
        """Where a drone is now."""
        sent_s = self._drones[drone.uid][1] if drone.uid in self._drones else -math.inf
        self._drones[drone.uid] = (drone, sent_s, True)
        self._drones.move_to_end(drone.uid)
        if len(self._drones) > self._most_drones:
            self._drones.popitem(last=False)
            self.left_out += 1

    def begin(self) -> None:
        """The link has opened: who is there may know nothing."""
        for slot in (*self._fires.values(), *self._leaving.values()):
            slot.sent, slot.sent_s, slot.withdrawn = None, -math.inf, 0
        self._drones = OrderedDict((uid, (one, -math.inf, True)) for uid, (one, _, _) in self._drones.items())

    def due(self, now_s: float, most: int) -> list[bytes]:
        """Events that are due, the most urgent first, and no more of them than `most` and one fire's."""
        events: list[bytes] = []
        for uid, slot in sorted(self._fires.items(), key=lambda one: _urgency(one[1].fire), reverse=True):
            if len(events) >= most:
                return events
            if _stale_s(slot.fire) <= now_s:
                self._expire(uid)
            elif self._is_due(slot, now_s):
                events += self._shown(slot, now_s)
        for uid, slot in list(self._leaving.items()):
            if len(events) >= most:
                return events
            if now_s - slot.sent_s >= PERIOD_S or now_s < slot.sent_s:
                events += self._withdrawn(uid, slot, now_s)
        return events + self._due_drones(now_s)

    def last_words(self, now_s: float) -> list[bytes]:
        """At the end: regions would stay on maps with nobody to take them back; markers fade by themselves."""
        return [
            cot.withdrawal(cot.region_uid(uid), cot.REGION, slot.place, now_s)
            for uid, slot in (*self._fires.items(), *self._leaving.items())
            if slot.is_region_on_maps
        ]

    def _is_due(self, slot: _Slot, now_s: float) -> bool:
        age_s = now_s - slot.sent_s
        if slot.sent is None or age_s < 0.0:  # the clock was set
            return True
        return age_s >= self._period_s or (age_s >= _SOONEST_S and _is_other(slot.sent, slot.fire))

    def _shown(self, slot: _Slot, now_s: float) -> list[bytes]:
        fire, lifetime_s = slot.fire, _stale_s(slot.fire) - now_s
        lifetime_s = min(lifetime_s, LIFETIME_S[fire.report.properties.state])
        region = cot.region_event(fire, now_s, min(lifetime_s, _REGION_PERIODS * self._period_s))
        events = [cot.fire_event(fire, now_s, lifetime_s), region]
        if region is None and slot.is_region_on_maps:
            events.append(cot.withdrawal(cot.region_uid(fire.uid), cot.REGION, slot.place, now_s))
        slot.sent, slot.sent_s, slot.is_on_maps, slot.place = fire, now_s, True, fire.place or slot.place
        slot.is_region_on_maps = region is not None
        return [one for one in events if one is not None]

    def _withdrawn(self, uid: str, slot: _Slot, now_s: float) -> list[bytes]:
        slot.sent_s, slot.withdrawn = now_s, slot.withdrawn + 1
        if slot.withdrawn >= _WITHDRAWN_TIMES:
            del self._leaving[uid]
        kinds, last = [(cot.region_uid(uid), cot.REGION)], None
        if slot.is_on_maps:
            kinds.append((uid, cot.fire_type(slot.fire)))
            last = cot.fire_event(slot.fire, now_s, _LAST_S)
        events = [last, *(cot.withdrawal(one, kind, slot.place, now_s) for one, kind in kinds)]
        return [one for one in events if one is not None]

    def _due_drones(self, now_s: float) -> list[bytes]:
        events = []
        for uid, (drone, sent_s, is_news) in self._drones.items():
            if is_news and not 0.0 <= now_s - sent_s < _DRONE_PERIOD_S:
                self._drones[uid] = (drone, now_s, False)
                events.append(cot.drone_event(drone, now_s, DRONE_LIFETIME_S))
        return [one for one in events if one is not None]

    def _leave(self, uid: str) -> None:
        """It is no fire, or not to be shown any more: taken off the maps where it may be on one."""
        slot = self._fires.pop(uid, None)
        if slot is not None and slot.is_on_maps:
            self._put_leaving(uid, slot)

    def _expire(self, uid: str) -> None:
        """Not seen for too long: the marker fades by itself, the region is taken back."""
        slot = self._fires.pop(uid, None)
        if slot is not None and slot.is_region_on_maps:
            slot.is_on_maps = False
            self._put_leaving(uid, slot)

    def _put_leaving(self, uid: str, slot: _Slot) -> None:
        slot.sent_s, slot.withdrawn = -math.inf, 0
        self._leaving[uid] = slot
        if len(self._leaving) > self._most_fires:
            self._leaving.popitem(last=False)
            self.left_out += 1

    def _make_room(self, fire: SharedFire) -> bool:
        """The least urgent gives way to what is more urgent."""
        self.left_out += 1
        worst = min(self._fires, key=lambda one: _urgency(self._fires[one].fire))
        if _urgency(self._fires[worst].fire) >= _urgency(fire):
            return False
        self._leave(worst)
        return True


def _urgency(fire: SharedFire) -> tuple[int, float]:
    return _URGENCY.index(fire.report.properties.state), fire.seen_s or -math.inf


def _stale_s(fire: SharedFire) -> float:
    """When it is too old to be shown; never for one whose times nobody knows, which goes by when it was told."""
    since_s = fire.told_s if fire.seen_s is None else fire.seen_s
    return -math.inf if since_s is None else since_s + LIFETIME_S[fire.report.properties.state]


def _is_other(sent: SharedFire, fire: SharedFire) -> bool:
    """Whether what was sent no longer holds: another state or name, another size, or a place outside that size."""
    if (sent.report.properties.state, sent.title.partition(" +-")[0]) != (
        fire.report.properties.state,
        fire.title.partition(" +-")[0],
    ):
        return True
    if sent.size_m is None or fire.size_m is None or sent.place is None or fire.place is None:
        return sent.size_m != fire.size_m
    if not 0.5 < fire.size_m[0] / sent.size_m[0] < 2.0:
        return True
    north_m = (fire.place[0] - sent.place[0]) * 111_000.0
    east_m = (fire.place[1] - sent.place[1] + 180.0) % 360.0 - 180.0
    east_m *= 111_000.0 * math.cos(math.radians(fire.place[0]))
    return math.hypot(north_m, east_m) > sent.size_m[1]
